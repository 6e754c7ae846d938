"""The explorer as its rows tell it: nothing else is kept of a search, so that none can be restored wrongly.

Equal rows give equal proposals. A synchronous exploration reports its measurements in the order of their
numbers, any other in the order in which they were finished.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from math import log2
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import ratios
from pareto import Explorer, Space
from pareto.errors import ConfigurationError
from pareto.search.methods import METHODS

Phase, State = Evaluation.Phase, Evaluation.State
FINISHED = (State.DONE, State.FAILED)
SEARCHED = (Phase.RANDOM, Phase.ACTIVE, Phase.AGAIN)  # counted to the budget
CHOSEN_ONCE = (Phase.RANDOM, Phase.ACTIVE)
COPIED = ratios.COPIED  # measured by another exploration
# Below this number of measurements nothing can be called an outlier; it is looked for whenever their number
# has doubled since.
FIRST_LOOK = 50
OUTLIER_DEVIATIONS = 6.0
LEAST_OUTLIER = 1.5  # times more or less: whatever is nearer is not an outlier, however well the others agree
MOST_OUTLIERS = 0.05  # of the measurements: where more lie far off, the forest is wrong and not they
CHECKS = 2  # with the first measurement three, of which the median counts


def space_of(exploration: Exploration) -> Space:
    """The space that is searched. Raises SpaceError where the description is not valid."""
    return _space(json.dumps(exploration.space))


@lru_cache(maxsize=8)
def _space(description: str) -> Space:
    return Space.from_dict(json.loads(description))


def fresh(exploration: Exploration, **more: Any) -> Explorer:
    """The explorer of a search that knows nothing yet. Raises ParetoError where there can be none."""
    return Explorer(
        space_of(exploration),
        exploration.objectives,
        exploration.limits,
        seed=exploration.seed,
        method=exploration.method,
        **exploration.options,
        **more,
    )


def place_of(space: Space, configuration: Mapping[str, Any]) -> int | None:
    """The number of CONFIGURATION in SPACE; None for a known one beside the grid."""
    try:
        return int(space.encode(configuration))
    except ConfigurationError:
        return None


class Row(NamedTuple):
    """What the search reads of an evaluation."""

    pk: int
    number: int
    phase: str
    label: str
    state: str
    iteration: int
    place: int | None  # in the space
    frames: int | None
    objectives: dict[str, float] | None
    parts: list[dict[str, Any]] | None
    censored: bool
    ratio_filled_at: datetime | None
    finished_at: datetime | None


def rows_of(exploration: Exploration) -> list[Row]:
    """All evaluations of the exploration in the order of their numbers. One query, ten thousand in 0.1 s."""
    found = exploration.evaluations.order_by("number").values_list(
        *("index" if name == "place" else name for name in Row._fields)
    )
    return list(map(Row._make, found))


def with_ratios(exploration: Exploration, rows: Sequence[Row]) -> list[Row]:
    """ROWS, all of the exploration, after every ratio that they allow is stored.

    Raises NoDefaultError where the default could not be measured.
    """
    filled = ratios.fill(exploration, rows)
    return [
        row._replace(objectives=filled[row.pk], ratio_filled_at=row.finished_at) if row.pk in filled else row
        for row in rows
    ]


def explorer(exploration: Exploration, evaluations: Sequence[Row]) -> Explorer:
    """The explorer that knows all of EVALUATIONS, those of the exploration in the order of their numbers."""
    rows = [row for row in evaluations if row.place is not None]
    found = fresh(exploration, **_prior(exploration))
    finished = [row for row in rows if _is_readable(exploration, row) and _counts(exploration, row)]
    if not exploration.synchronous:
        finished.sort(key=_finished)
    asked = [row for row in rows if row.phase in (*SEARCHED, Phase.GIVEN)]
    unfinished = [row for row in asked if not _is_readable(exploration, row)]
    groups: dict[int, list[Row]] = {}
    for row in finished:
        groups.setdefault(row.place, []).append(row)  # type: ignore[arg-type]
    state = found.state() | {
        "asks": len({row.iteration for row in evaluations if row.phase in SEARCHED}),
        "observations": [
            [index, group[0].phase, _measurements(group, exploration.objectives)]
            for index, group in groups.items()
        ],
        "pending": [[row.place, row.phase] for row in unfinished if _is_pending(row, groups)],
    }
    return Explorer.restore(found.space, state)


def recommended(exploration: Exploration, evaluations: Sequence[Row]) -> list[dict[str, Any]] | None:
    """The configurations on the front of expected values; None where no measurements of one differ."""
    found = explorer(exploration, evaluations)
    if not found.estimates().noisy:
        return None
    return [item.configuration for item in found.recommended()]


def outliers(exploration: Exploration, evaluations: Sequence[Row]) -> list[Row]:
    """Single measurements to be made again, since they lie far from what the others lead to expect.

    The others' word is a random forest's out-of-bag prediction, in logarithms where all values are positive.
    Far is beyond OUTLIER_DEVIATIONS robust standard deviations (1.4826 times the median absolute one) of all
    such residuals, and more than LEAST_OUTLIER times more or less; at most MOST_OUTLIERS of all, the
    farthest. Looked for once whenever the search has asked for FIRST_LOOK evaluations, twice that, four times
    that, ...: not every batch, as it takes a second. What was asked for decides that, not what is finished,
    since in an asynchronous search a look must neither be left out nor come twice. Measurements that ended
    before all sequences were run are left out: how large their errors are is not known.
    """
    searched = [row for row in evaluations if row.phase in SEARCHED]
    newest = max((row.iteration for row in searched), default=0)
    before = sum(row.iteration < newest for row in searched)
    looked = any(row.phase == Phase.CHECK and row.iteration > newest for row in evaluations)
    if looked or _looks(len(searched)) == _looks(before):
        return []
    checked = {row.place for row in evaluations if row.phase == Phase.CHECK}
    checked |= {row.place for row in searched if row.phase == Phase.AGAIN}
    once = [row for row in searched if row.place not in checked]
    done = [row for row in once if row.state == State.DONE and not ratios.awaits(exploration, row)]
    done = [row for row in done if not row.censored]
    space = space_of(exploration)
    indices = np.array([row.place for row in done], dtype=np.int64)
    far = np.zeros(len(done))
    for name in exploration.objectives:
        far = np.maximum(far, _far(space, indices, _column(done, name)))
    farthest = np.argsort(-far, kind="stable")[: int(MOST_OUTLIERS * len(done))]
    return [done[place] for place in sorted(farthest) if far[place] > OUTLIER_DEVIATIONS]


def whole_rounds(exploration: Exploration) -> bool:
    """Whether the method asks for all of a round at once: to deal it out it would have to remember it."""
    return exploration.method == "algorithm1"


def _far(space: Space, indices: np.ndarray, values: np.ndarray) -> np.ndarray:
    """How many robust standard deviations each of VALUES lies off, 0 for what is too little to matter."""
    from pareto.surrogates.prediction import predictions  # scikit-learn takes a second to import

    far = np.zeros(len(indices))
    prediction = predictions(space, indices, values)
    if prediction is None:
        return far
    scale = np.log if prediction.log else np.asarray
    residual = scale(prediction.measured) - scale(prediction.predicted)
    deviation = np.abs(residual - np.median(residual))
    spread = max(1.4826 * float(np.median(deviation)), np.finfo(float).tiny)
    least = np.log(LEAST_OUTLIER) if prediction.log else (LEAST_OUTLIER - 1) * np.abs(prediction.predicted)
    far[prediction.rows] = np.where(deviation > least, deviation / spread, 0.0)
    return far


def _looks(measurements: int) -> int:
    return 0 if measurements < FIRST_LOOK else 1 + int(log2(measurements / FIRST_LOOK))


def _column(rows: Iterable[Row], name: str) -> np.ndarray:
    return np.array([(row.objectives or {}).get(name, np.nan) for row in rows], dtype=np.float64)


def _counts(exploration: Exploration, row: Row) -> bool:
    """Whether the explorer learns it: not what another device measured, or over other frames, nor the default
    that a round is compared with."""
    return row.phase not in (Phase.PRIOR, Phase.DEFAULT) and row.frames == exploration.frames


def _is_readable(exploration: Exploration, row: Row) -> bool:
    """Whether ROW is finished, and has its ratio where the exploration minimises it."""
    return row.state in FINISHED and not ratios.awaits(exploration, row)


def _is_pending(row: Row, groups: Mapping[int, Sequence[Row]]) -> bool:
    """Whether the explorer waits for ROW: not where a first measurement of its configuration is known."""
    return row.phase == Phase.AGAIN or row.place not in groups


def _measurements(group: Sequence[Row], objectives: Sequence[str]) -> list[list[Any] | None]:
    """The measurements of one configuration that the explorer learns.

    Checks replace an outlier, so that the median of it and its checks is one measurement. Each measurement
    that the search asked for again, and each repeat, is one more.
    """
    apart = (Phase.AGAIN, Phase.REPEAT)
    first = [row for row in group if row.phase not in apart]
    further = [_values([row], objectives) for row in group if row.phase in apart]
    return [_values(first, objectives), *further] if first else further


def _values(group: Sequence[Row], objectives: Sequence[str]) -> list[Any] | None:
    """Of several measurements of one configuration the median counts; None where all of them failed.

    An error that is only known to be at least so large is reported as such.
    """
    rows = [row for row in group if row.objectives and set(objectives) <= set(row.objectives)]
    if not rows:
        return None
    censored = any(row.censored for row in rows)
    values = {name: float(median((row.objectives or {})[name] for row in rows)) for name in objectives}
    return [
        {"censored": value} if censored and name.startswith("ate_") else value
        for name, value in values.items()
    ]


def _finished(row: Row) -> tuple[float, int]:
    return (row.finished_at.timestamp() if row.finished_at else 0.0, row.number)


def prior(exploration: Exploration, pairs: Sequence[tuple[Any, Any]]) -> dict[str, Any]:
    """The option of `fresh` for what other devices say, where there is any and the method can use it.

    PAIRS are configurations in the space with their objectives, None for a failure.
    """
    return {"prior": pairs} if pairs and METHODS[exploration.method].uses_prior else {}


def _prior(exploration: Exploration) -> dict[str, Any]:
    if exploration.warm_start_from_id is None:
        return {}
    copied = exploration.evaluations.filter(phase=Phase.PRIOR, index__isnull=False).order_by("number")
    return prior(exploration, list(copied.values_list("configuration", "objectives")))
