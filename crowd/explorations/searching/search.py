"""Rebuilds the explorer of a search from its evaluations. No other state of a search is stored.

Equal rows give equal proposals. A synchronous exploration reports its measurements to the explorer in the
order of their numbers, an asynchronous one in the order in which they finished.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from math import log2
from statistics import median
from typing import Any

import numpy as np
from django.db.models import QuerySet

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import LOST_MORE
from crowd.explorations.searching import ratios
from pareto import Explorer, Space
from pareto.errors import ConfigurationError
from pareto.fronts.censored import mark_censored
from pareto.search import stopping
from pareto.search.history import History
from pareto.search.methods import METHODS
from slam.definitions import OPTIONAL, without_optional
from slam.stopping import CONDITIONED, ERROR

Phase, State = Evaluation.Phase, Evaluation.State
FINISHED = (State.DONE, State.FAILED)
SEARCHED = (Phase.RANDOM, Phase.ACTIVE, Phase.AGAIN)  # counted to the budget
CHOSEN_ONCE = (Phase.RANDOM, Phase.ACTIVE)
COPIED = ratios.COPIED  # measured by another exploration
# The search for outliers starts at this number of measurements, and is repeated each time it doubles.
FIRST_LOOK = 50
OUTLIER_DEVIATIONS = 6.0
LEAST_OUTLIER_FACTOR = 1.5  # a measurement within this factor is never an outlier
MAX_OUTLIER_SHARE = 0.05  # of the measurements: if more are far off, the forest is wrong
CHECKS = 2  # with the first measurement three, of which the median counts
# What a search and its points read of an evaluation.
_COLUMNS = (
    *("exploration", "number", "phase", "label", "state", "iteration", "configuration", "configuration_key"),
    *("index", "frames", "objectives", "parts", "censored", "ratio_filled_at", "created_at", "finished_at"),
)


def search_space(exploration: Exploration) -> Space:
    """The space of `exploration`. Raises SpaceError if its description is not valid."""
    return _space(json.dumps(exploration.space))


@lru_cache(maxsize=8)
def _space(description: str) -> Space:
    return Space.from_dict(json.loads(description))


def new_explorer(exploration: Exploration, **more: Any) -> Explorer:
    """An explorer without measurements. Raises ParetoError if it cannot be created."""
    return Explorer(
        search_space(exploration),
        exploration.objectives,
        exploration.limits,
        seed=exploration.seed,
        method=exploration.method,
        budget=exploration.budget,
        **exploration.options,
        **more,
    )


def stop_conditions(exploration: Exploration, history: History) -> list[dict[str, float]]:
    """What ends a measurement early: the limits and the finished points of `history`.

    Only conditions that a machine can check while it measures, so none on ratios. The time over several
    sequences is known after the last one, so that there only the error counts.
    """
    measurable = CONDITIONED if len(exploration.learned_on) == 1 else (ERROR,)
    return [dict(one) for one in stopping.stop_conditions(history) if set(one) <= set(measurable)]


def space_index(space: Space, configuration: Mapping[str, Any]) -> int | None:
    """The number of `configuration` in `space`; None if it is not in the space."""
    try:
        return int(space.encode(with_optional(space, configuration)))
    except ConfigurationError:
        return None


def with_optional(space: Space, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """`configuration` with 0 for each optional parameter of `space` that it leaves out."""
    optional = [one.name for one in space.parameters if one.name in OPTIONAL and one.condition is None]
    return dict.fromkeys(optional, 0) | dict(configuration)


def for_search(evaluations: QuerySet[Evaluation]) -> QuerySet[Evaluation]:
    """`evaluations` with the columns that a search and its points read: others cost a query each."""
    return evaluations.only(*_COLUMNS)


def read_rows(exploration: Exploration) -> list[Evaluation]:
    """All evaluations of `exploration` in the order of their numbers. One query."""
    return list(for_search(exploration.evaluations.order_by("number")))


def informed_explorer(exploration: Exploration, evaluations: Sequence[Evaluation]) -> Explorer:
    """An explorer with all `evaluations` of `exploration`, given in the order of their numbers."""
    rows = [row for row in evaluations if row.index is not None]
    compares = ratios.uses_ratio(exploration)
    rounds = ratios.default_rounds(exploration, evaluations) if compares else None
    explorer = new_explorer(exploration, rounds=rounds, **_prior(exploration))
    finished = [row for row in rows if _is_readable(exploration, row) and _is_learned(exploration, row)]
    if not exploration.synchronous:
        finished.sort(key=_finished)
    asked = [row for row in rows if row.phase in (*SEARCHED, Phase.GIVEN)]
    unfinished = [row for row in asked if not _is_readable(exploration, row)]
    groups: dict[int, list[Evaluation]] = {}
    for row in finished:
        groups.setdefault(row.index, []).append(row)  # type: ignore[arg-type]
    state = explorer.state() | {
        "asks": len({row.iteration for row in evaluations if row.phase in SEARCHED}),
        "observations": [
            [index, group[0].phase, _measurements(group, exploration.objectives)]
            for index, group in groups.items()
        ],
        "pending": [[row.index, row.phase] for row in unfinished if _is_pending(row, groups)],
    }
    return Explorer.restore(explorer.space, state)


def recommended_configurations(
    exploration: Exploration, evaluations: Sequence[Evaluation]
) -> list[dict[str, Any]] | None:
    """The configurations on the front of expected values; None without noise in repeated measurements."""
    explorer = informed_explorer(exploration, evaluations)
    if not explorer.estimates().noisy:
        return None
    return [without_optional(item.configuration) for item in explorer.recommended()]


def outliers(exploration: Exploration, evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Measurements to check, since they are far from what the others predict.

    The prediction is a random forest's out-of-bag prediction, in logarithms if all values are positive. An
    outlier is beyond OUTLIER_DEVIATIONS robust standard deviations (1.4826 times the median absolute one) of
    these residuals and beyond LEAST_OUTLIER_FACTOR. At most MAX_OUTLIER_SHARE of all are checked, the
    farthest first. As it takes a second, it only runs when the search has proposed FIRST_LOOK evaluations,
    twice that, four times that, ... The number of proposals decides, so that an asynchronous search neither
    skips nor repeats it. Measurements that ended early are left out: their errors are unknown.
    """
    searched = [row for row in evaluations if row.phase in SEARCHED]
    newest = max((row.iteration for row in searched), default=0)
    before = sum(row.iteration < newest for row in searched)
    looked = any(row.phase == Phase.CHECK and row.iteration > newest for row in evaluations)
    if looked or _look_number(len(searched)) == _look_number(before):
        return []
    checked = {row.index for row in evaluations if row.phase == Phase.CHECK}
    checked |= {row.index for row in searched if row.phase == Phase.AGAIN}
    once = [row for row in searched if row.index not in checked]
    done = [row for row in once if row.state == State.DONE and not ratios.awaits_ratio(exploration, row)]
    done = [row for row in done if not row.censored]
    space = search_space(exploration)
    indices = np.array([row.index for row in done], dtype=np.int64)
    far = np.zeros(len(done))
    for name in exploration.objectives:
        far = np.maximum(far, _deviations(space, indices, _column(done, name)))
    farthest = np.argsort(-far, kind="stable")[: int(MAX_OUTLIER_SHARE * len(done))]
    return [done[index] for index in sorted(farthest) if far[index] > OUTLIER_DEVIATIONS]


def _deviations(space: Space, indices: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The deviation of each of `values` in robust standard deviations; 0 below LEAST_OUTLIER_FACTOR."""
    from pareto.surrogates.prediction import predictions  # scikit-learn takes a second to import

    far = np.zeros(len(indices))
    prediction = predictions(space, indices, values)
    if prediction is None:
        return far
    scale = np.log if prediction.log else np.asarray
    residual = scale(prediction.measured) - scale(prediction.predicted)
    deviation = np.abs(residual - np.median(residual))
    spread = max(1.4826 * float(np.median(deviation)), np.finfo(float).tiny)
    least = (
        np.log(LEAST_OUTLIER_FACTOR)
        if prediction.log
        else (LEAST_OUTLIER_FACTOR - 1) * np.abs(prediction.predicted)
    )
    far[prediction.rows] = np.where(deviation > least, deviation / spread, 0.0)
    return far


def _look_number(measurements: int) -> int:
    return 0 if measurements < FIRST_LOOK else 1 + int(log2(measurements / FIRST_LOOK))


def _column(rows: Iterable[Evaluation], name: str) -> np.ndarray:
    return np.array([(row.objectives or {}).get(name, np.nan) for row in rows], dtype=np.float64)


def _is_learned(exploration: Exploration, row: Evaluation) -> bool:
    """Whether the explorer learns `row`: not a prior, the default of a round, or over other frames."""
    return row.phase not in (Phase.PRIOR, Phase.DEFAULT) and row.frames == exploration.frames


def _is_readable(exploration: Exploration, row: Evaluation) -> bool:
    """Whether `row` is finished and has its ratios, if the exploration minimises one."""
    return row.state in FINISHED and not ratios.awaits_ratio(exploration, row)


def _is_pending(row: Evaluation, groups: Mapping[int, Sequence[Evaluation]]) -> bool:
    """Whether the explorer waits for `row`: its configuration has no measurement, or is measured again."""
    return row.phase == Phase.AGAIN or row.index not in groups


def _measurements(group: Sequence[Evaluation], objectives: Sequence[str]) -> list[list[Any] | None]:
    """The measurements of one configuration that the explorer learns.

    The first measurement and its checks count as one, their median. Each measurement that the search
    requested again, and each repeat, counts separately.
    """
    apart = (Phase.AGAIN, Phase.REPEAT)
    first = [row for row in group if row.phase not in apart]
    further = [_values([row], objectives) for row in group if row.phase in apart]
    return [_values(first, objectives), *further] if first else further


def _values(group: Sequence[Evaluation], objectives: Sequence[str]) -> list[Any] | None:
    """The median of several measurements of one configuration; None if all failed, or if one lost the camera
    more often than the default.

    A lower bound is marked as censored.
    """
    rows = [row for row in group if row.objectives and set(objectives) <= set(row.objectives)]
    if not rows or any((row.objectives or {}).get(LOST_MORE, 0) > 0 for row in rows):
        return None
    censored = {name for row in rows for name in row.censored}
    values = {name: float(median((row.objectives or {})[name] for row in rows)) for name in objectives}
    return [{"censored": value} if name in censored else value for name, value in values.items()]


def _finished(row: Evaluation) -> tuple[float, int]:
    return (row.finished_at.timestamp() if row.finished_at else 0.0, row.number)


def prior(exploration: Exploration, pairs: Sequence[tuple[Any, Any]]) -> dict[str, Any]:
    """The option `prior` of an explorer, if there are `pairs` and the method can use them.

    `pairs`: configurations in the space with objectives from another device; None for a failure.
    """
    if not pairs or not METHODS[exploration.method].uses_prior:
        return {}
    space = search_space(exploration)
    return {"prior": [(with_optional(space, configuration), values) for configuration, values in pairs]}


def _prior(exploration: Exploration) -> dict[str, Any]:
    if exploration.warm_start_from_id is None:
        return {}
    copied = exploration.evaluations.filter(phase=Phase.PRIOR, index__isnull=False).order_by("number")
    rows = copied.values_list("configuration", "objectives", "censored")
    return prior(exploration, [(configuration, _marked(*values)) for configuration, *values in rows])


def _marked(objectives: Mapping[str, float] | None, censored: Sequence[str]) -> dict[str, float] | None:
    """`objectives` with Censored ones for the names in `censored`; None for a failure."""
    return None if objectives is None else mark_censored(objectives, ",".join(censored), censored)
