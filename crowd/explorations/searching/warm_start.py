"""What an earlier exploration measured, copied into a new one that starts from it."""

from collections.abc import Mapping
from typing import Any

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import ERROR_RATIO, RATIO
from crowd.explorations.searching import ratios, search
from crowd.explorations.searching.search import COPIED, FINISHED

ALIKE = ("reference_device_id", "learned_on", "error_quantile", "frames")
COPIED_FIELDS = (
    *("label", "configuration", "configuration_key", "frames", "state", "objectives", "stages", "device"),
    *("software", "error", "worker", "finished_at", "perturbation", "parts", "censored"),
)


def copies(exploration: Exploration, earlier: Exploration) -> list[Evaluation]:
    """What EARLIER measured is known: as if measured here where nothing differs, else as a prior.

    Rows for EXPLORATION, numbered from 0 and not stored. Their ratios are those to EARLIER's own
    default. Its measurements once a round are not copied, only that among the known configurations.
    """
    alike = all(getattr(earlier, name) == getattr(exploration, name) for name in ALIKE)
    space = search.space_of(exploration)
    every = list(earlier.evaluations.all())
    found = ratios.ratios(earlier, every, patient=False) if ratios.used(exploration) else {}
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
            phase=Evaluation.Phase.KNOWN if alike else Evaluation.Phase.PRIOR,
            index=search.place_of(space, row.configuration),
            copied_from=row,
            **{name: getattr(row, name) for name in COPIED_FIELDS} | _ratio(row, found),
        )
        for number, row in enumerate(rows)
    ]


def check(exploration: Exploration, earlier: Exploration) -> None:
    """Raise ParetoError where no explorer can begin with what EARLIER measured. Nothing is learnt for it."""
    rows = copies(exploration, earlier)
    measured = [row.objectives for row in rows if row.objectives]
    for name in (RATIO, ERROR_RATIO):
        if name in exploration.objectives and not all(name in objectives for objectives in measured):
            raise ratios.NoDefaultError(
                f"{earlier} has measurements but none of the default, so that their {name} is not known: "
                f"choose another one to start from, or the objective {name.removesuffix('_ratio')}"
            )
    copied = [row for row in rows if row.phase == Evaluation.Phase.PRIOR and row.index is not None]
    pairs = [(row.configuration, row.objectives) for row in copied]
    search.fresh(exploration, **search.prior(exploration, pairs))


def _ratio(row: Evaluation, found: Mapping[int, Mapping[str, float]]) -> dict[str, Any]:
    """What the copy of ROW has beyond it: those ratios in FOUND that were not filled in already."""
    if row.pk not in found or row.objectives is None:
        return {}
    return {"objectives": {**found[row.pk], **row.objectives}}
