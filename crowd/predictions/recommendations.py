"""Recommends a configuration for a device, and judges earlier recommendations."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from crowd.fronts.models import Configuration
from crowd.predictions.expectations import FrontPrediction, LearnedMap, PredictedPoint, predict
from crowd.predictions.measurements import Group, counted
from crowd.predictions.models import Recommendation
from crowd.predictions.tables import CrowdTable
from crowd.results.models import DeviceSpeedup, State
from wire.front import BEST, Front
from wire.protocol import VALID_BELOW


class LimitsNotMetError(LookupError):
    """No configuration meets the limits. The message names the nearest value."""


@dataclass(frozen=True)
class JudgedRecommendation:
    """A recommendation that the device measured later.

    `regret`: how many times slower it is than the fastest measured point within the limit, 1 or more.
    `best_regret`: the same of the published best, None if it was not measured.
    """

    recommendation: Recommendation
    ratio: float
    regret: float
    best_regret: float | None
    within_interval: bool


def recommend(
    expected: FrontPrediction, max_ate: float = VALID_BELOW, max_seconds: float | None = None
) -> PredictedPoint:
    """The fastest point with an error of at most `max_ate` (m).

    With `max_seconds` per frame: the most accurate point that meets both limits. The published best is kept
    unless another point wins by more than its interval. Probes are never recommended, because they were not
    checked on held-out sequences; nor is a point that is much worse than the default there. Raises
    LimitsNotMetError.
    """
    points = [point for point in expected.points if not point.probe]
    with_error = within(points, math.inf)
    if not with_error:
        raise LimitsNotMetError("no configuration of this front has a known error")
    exact = within(points, max_ate)
    if not exact:
        least = min(with_error, key=_error)
        raise LimitsNotMetError(
            f"no configuration has an error of at most {max_ate:g} m: the least is {_error(least):.4f} m, "
            f"by {least.configuration}"
        )
    if max_seconds is not None:
        if expected.seconds is None:
            raise LimitsNotMetError("the time per frame on this device is unknown: leave out max_ms")
        quick = [point for point in exact if expected.seconds / point.ratio <= max_seconds]
        if not quick:
            fastest = expected.seconds / max(point.ratio for point in exact)
            raise LimitsNotMetError(
                f"no configuration takes at most {1e3 * max_seconds:g} ms a frame: the fastest within the "
                f"error takes {1e3 * fastest:.3g} ms"
            )
        return min(quick, key=_error)
    published = next((point for point in exact if point.configuration == BEST), None)
    if published is None:
        return max(exact, key=_ratio)
    return max((point for point in exact if point.low > published.ratio), key=_ratio, default=published)


def within(points: Iterable[PredictedPoint], max_ate: float) -> list[PredictedPoint]:
    """Those of `points` that generalise, with a known error of at most `max_ate` (m)."""
    known = [point for point in points if point.ate_max is not None and point.ate_max <= max_ate]
    return [point for point in known if point.generalises]


def store_recommendations(front: Front, group: Group, table: CrowdTable, learned: LearnedMap) -> int:
    """Store the recommendation for each device of `table` that did not measure it yet, once.

    Returns for how many devices it is not the published best.
    """
    rows = Recommendation.objects.filter(**group._asdict())
    noted = set(rows.order_by().values_list("device", "processor", "configuration__name"))
    names = dict(Configuration.objects.filter(front=group.front_id).values_list("name", "pk"))
    others = 0
    made = []
    for row in table.rows.itertuples():
        family = str(table.known.families[row.Index])
        try:
            point = recommend(predict(front, table, learned, str(row.Index), family))
        except LimitsNotMetError:
            continue
        others += point.configuration != BEST
        if point.measured or (row.device, row.processor, point.configuration) in noted:
            continue
        made.append(
            Recommendation(
                **group._asdict(),
                device_id=row.device,
                processor=row.processor,
                configuration_id=names[point.configuration],
                rung=learned.rung,
                log_ratio=math.log(point.ratio),
                low=math.log(point.low),
                high=math.log(point.high),
            )
        )
    Recommendation.objects.bulk_create(made, batch_size=500)
    return others


def judged_recommendations(front: str) -> list[JudgedRecommendation]:
    """The recommendations of `front` (slug) that figures that count judge, oldest first. Two queries."""
    rows = Recommendation.objects.filter(front__slug=front).select_related("device", "configuration")
    advice = list(rows.order_by("pk"))
    keys = ("device_id", "backend", "processor", "processor_class")
    figures = DeviceSpeedup.objects.filter(
        counted(), front__slug=front, state=State.VALID, configuration__probe=False,
        device__in={one.device_id for one in advice},
    ).filter(ate_max__lte=VALID_BELOW)  # fmt: skip
    measured: dict[tuple[object, ...], dict[str, float]] = {}
    for *key, name, speedup in figures.order_by().values_list(*keys, "configuration__name", "speedup"):
        measured.setdefault(tuple(key), {})[name] = speedup
    judged = []
    for one in advice:
        there = measured.get(tuple(getattr(one, key) for key in keys), {})
        ratio = there.get(one.configuration.name)
        if ratio is None:
            continue
        most, best = max(1.0, *there.values()), there.get(BEST)
        within = one.low <= math.log(ratio) <= one.high
        judged.append(JudgedRecommendation(one, ratio, most / ratio, best and most / best, within))
    return judged


def _ratio(point: PredictedPoint) -> float:
    return point.ratio


def _error(point: PredictedPoint) -> float:
    assert point.ate_max is not None  # points without an error were left out
    return point.ate_max
