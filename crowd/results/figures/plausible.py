"""Which speedups of a cohort are plausible, and which are possible: what the front and the crowd know."""

import math
from collections import defaultdict

from django.conf import settings
from django.db.models import OuterRef, Subquery

from crowd.fronts import selectors
from crowd.fronts.content import plans
from crowd.results.figures import confirmation
from crowd.results.intake import packing
from crowd.results.models import Cohort, DeviceSpeedup, Run, SessionSummary, State
from crowd.results.validity import plausibility
from crowd.results.validity.plausibility import Bounds
from slam.kfusion.work import REFERENCE_MARGIN, StageRanges, widened, with_other, work_range
from wire.front import BEST, DEFAULT, Front, Point, predicted_speedup

# Of so many device models, the first session is read: more hardly add another kind of chip.
MOST_MODELS = 100


class PlausibilityBounds:
    """The plausible and the possible ranges of log ratios, by configuration (key). All is read once."""

    def __init__(self) -> None:
        self._fronts: dict[int, Front] = {}
        self._points: dict[int, Point] = {}
        self._confirmed_speedups: dict[tuple[int, str], list[tuple[float, int]]] = {}
        self._confirmed_shares: dict[tuple[int, str], StageRanges] = {}

    def plausible(self, cohort: Cohort, configuration: int) -> Bounds:
        """The log ratios of `configuration` that need no confirmation."""
        key = (configuration, cohort.backend)
        if key not in self._confirmed_speedups:
            self._confirmed_speedups[key] = _confirmed_speedups(*key)
        reached = self._confirmed_speedups[key]
        others = (
            next((speedup for speedup, device in rows if device != cohort.device_id), None)
            for rows in (reached, reversed(reached))
        )
        front, point = self._of(cohort, configuration)
        return plausibility.plausible_range(
            _prediction(front, point), [math.log(speedup) for speedup in others if speedup]
        )

    def possible(self, cohort: Cohort, configuration: int) -> Bounds:
        """The log ratios of `configuration` that may be confirmed, as the front alone says."""
        return possible_range(*self._of(cohort, configuration))

    def confirmed_possible(self, cohort: Cohort, configuration: int) -> Bounds:
        """As `possible`, with the stage times of confirmed models, too. Two queries for each backend."""
        key = (cohort.front_id, cohort.backend)
        front, point = self._of(cohort, configuration)
        if key not in self._confirmed_shares:
            self._confirmed_shares[key] = _confirmed_shares(front, *key)
        return possible_range(front, point, self._confirmed_shares[key])

    def _of(self, cohort: Cohort, configuration: int) -> tuple[Front, Point]:
        if cohort.front_id not in self._fronts:
            front = self._fronts[cohort.front_id] = selectors.front_in_any_state(cohort.front_id)
            every = {point.name: point for point in (*front.points, *front.probes)}
            self._points |= {key: every[name] for key, name in selectors.configuration_names(front.slug)}
        return self._fronts[cohort.front_id], self._points[configuration]


def possible_range(front: Front, point: Point, confirmed: StageRanges | None = None) -> Bounds:
    """The log ratios of `point` of `front` that may count if others confirm them.

    The work in its plan bounds them. The shares of stages in the default's frame are those that the front's
    reference device measured, widened, and those that `confirmed` models showed. These only extend the range:
    three networks could otherwise narrow it, and honest sessions could not be confirmed any more.
    Without a plan, the reach of the prediction is lifted by LOG_LIFT.
    """
    ratios = plans.stage_ratios(front, point)
    if ratios is None:
        low, high = plausibility.plausible_range(_prediction(front, point), [])
        return low - plausibility.LOG_LIFT, high + plausibility.LOG_LIFT
    default = front.point(DEFAULT)
    times = default.predicted.on_sequence if default else None
    stages = times.stages if times else {}
    shares = widened(with_other(stages), REFERENCE_MARGIN) if stages else {}
    return work_range(ratios, plausibility.hull(shares, confirmed or {}))


def _prediction(front: Front, point: Point) -> float | None:
    default = front.point(DEFAULT)
    return None if default is None else predicted_speedup(default.predicted, point.predicted)


def _confirmed_speedups(configuration: int, backend: str) -> list[tuple[float, int]]:
    """The confirmed speedups of `configuration` with `backend`, ascending, each with its device.

    One query.
    """
    rows = DeviceSpeedup.objects.filter(
        configuration=configuration,
        backend=backend,
        witnesses__gte=settings.FRONTRUNNER_QUORUM,
        state=State.VALID,
    )
    return sorted(rows.order_by().values_list("speedup", "device_id"))


def _confirmed_shares(front: Front, key: int, backend: str) -> StageRanges:
    """The widened shares of the default's stages in the first session of each of the first MOST_MODELS models
    of `front` (`key`) that are confirmed with `backend`. Two queries.

    An impossible session costs no more, however large the crowd is.
    """
    confirmed = DeviceSpeedup.objects.filter(
        confirmation.confirmed(), front=key, backend=backend, state=State.VALID
    )
    counted = SessionSummary.objects.filter(
        cohort=OuterRef("pk"), configuration__name=BEST, state=State.VALID, counted=True
    )
    cohorts = Cohort.objects.filter(
        front=key, backend=backend, device__in=confirmed.order_by().values("device")
    ).annotate(first=Subquery(counted.order_by("session").values("session")[:1]))
    sessions = cohorts.exclude(first=None).order_by("pk").values_list("first", flat=True)[:MOST_MODELS]
    runs = Run.objects.filter(session__in=list(sessions), configuration__name=DEFAULT, state=State.VALID)
    first = front.protocol.first_counted_frame
    shares_by_stage: dict[str, list[float]] = defaultdict(list)
    for content in runs.values_list("frames__content", flat=True):
        series = packing.decompress(content)
        if not series.stages:
            continue
        total = float(packing.unpack(series.frame_us)[first:].sum())
        stages = {
            name: float(times[first:].sum()) / total
            for name, times in packing.unpack_stages(series.stages, series.stages_us).items()
        }
        for name, share in with_other(stages).items():
            shares_by_stage[name].append(share)
    ranges: StageRanges = {}
    for one in (min, max):
        edge = widened(
            {name: one(shares) for name, shares in shares_by_stage.items()}, plausibility.CONFIRMED_MARGIN
        )
        ranges = plausibility.hull(edge, ranges)
    return ranges
