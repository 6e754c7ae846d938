"""Copies the measurements of an earlier exploration into a new one that starts from it."""

from collections.abc import Mapping
from typing import Any

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import BESIDE_DEFAULT
from crowd.explorations.searching import ratios, search
from crowd.explorations.searching.search import COPIED, FINISHED
from pareto.errors import ObjectiveError
from wire.evaluation import Outcome

COMPARED_FIELDS = ("reference_device_id", "learned_on", "error_quantile", "frames")
COPIED_FIELDS = (
    *("label", "configuration", "configuration_key", "frames", "state", "worker", "finished_at"),
    *("perturbation", *Outcome.__struct_fields__),
)


def copies(exploration: Exploration, earlier: Exploration) -> list[Evaluation]:
    """Unsaved copies of `earlier`'s measurements for `exploration`, numbered from 0.

    They are known measurements if all COMPARED_FIELDS are equal, else a prior. Their ratios are relative to
    `earlier`'s default. Of its default, only the measurement among the known configurations is copied.
    """
    same = all(getattr(earlier, name) == getattr(exploration, name) for name in COMPARED_FIELDS)
    space = search.search_space(exploration)
    every = list(earlier.evaluations.all())
    computed = ratios.compute_ratios(earlier, every, patient=False) if ratios.uses_ratio(exploration) else {}
    rows = [
        row
        for row in every
        if row.state in FINISHED
        and row.phase not in (*COPIED, Evaluation.Phase.DEFAULT)
        and row.frames == earlier.frames
    ]
    return [
        Evaluation(
            exploration=exploration,
            number=number,
            phase=Evaluation.Phase.KNOWN if same else Evaluation.Phase.PRIOR,
            index=search.space_index(space, row.configuration),
            copied_from=row,
            **{name: getattr(row, name) for name in COPIED_FIELDS} | _ratio(row, computed),
        )
        for number, row in enumerate(rows)
    ]


def check_warm_start(exploration: Exploration, earlier: Exploration) -> None:
    """Raise ParetoError if no explorer can start from the measurements of `earlier`."""
    rows = copies(exploration, earlier)
    measured = [row.objectives for row in rows if row.objectives]
    for name in exploration.objectives:
        if all(name in objectives for objectives in measured):
            continue
        if name not in BESIDE_DEFAULT:
            raise ObjectiveError(f"{earlier} did not measure {name}: choose another one to start from")
        raise ratios.NoDefaultError(
            f"{earlier} has measurements but none of the default, so that their {name} is not known: "
            f"choose another one to start from, or the objective {name.removesuffix('_ratio')}"
        )
    copied = [row for row in rows if row.phase == Evaluation.Phase.PRIOR and row.index is not None]
    pairs = [(row.configuration, row.objectives) for row in copied]
    search.new_explorer(exploration, **search.prior(exploration, pairs))


def _ratio(row: Evaluation, computed: Mapping[int, Mapping[str, float]]) -> dict[str, Any]:
    """The objectives of the copy of `row` with the ratios in `computed` that it lacks."""
    if row.pk not in computed or row.objectives is None:
        return {}
    return {"objectives": {**computed[row.pk], **row.objectives}}
