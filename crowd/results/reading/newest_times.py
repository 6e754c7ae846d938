"""Times per frame with default and best, from the newest valid session of a figure."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean
from typing import Any
from uuid import UUID

from django.db.models import OuterRef, QuerySet, Subquery

from crowd.devices.disclosure import find
from crowd.records.speedup import Speedup
from crowd.results.models import Cohort, Run, SessionSummary, State
from crowd.results.reading.rows import DeviceDetail
from wire.front import BEST, DEFAULT


@dataclass(frozen=True)
class NewestTimes:
    """Seconds per frame with default and best in one session.

    Geometric means over the pairs of runs, so that their ratio is exactly the session's `speedup`.
    """

    session: UUID
    default: float
    best: float

    @property
    def speedup(self) -> float:
        return self.default / self.best


def newest_times(detail: DeviceDetail, figure: Speedup) -> NewestTimes | None:
    """The newest times of `figure` of the device in `detail`; None without a valid session.

    No query if it is the session that `detail` contains, else two.
    """
    latest = detail.latest
    measured_as = (figure.front, figure.backend, figure.processor)
    classes = {
        row.processor_class
        for row in detail.speedups
        if (row.front, row.backend, row.processor) == measured_as
    }
    if latest is not None and len(classes) == 1:
        session = latest.session
        answer = session.speedup(BEST)
        shown = (session.front, session.backend, session.processor)
        if answer is not None and answer.state == State.VALID and shown == measured_as:
            runs = [series.run for series in latest.runs if series.run.state == State.VALID]
            return _paired(session.uuid, ((run.configuration, run.repeat, run.mean_seconds) for run in runs))
    model = find(figure.device.slug)
    return None if model is None else times_of_device(figure, model.pk)


def newest_sessions(cohorts: QuerySet[Cohort]) -> QuerySet[Cohort, Any]:
    """The key of the newest session with a valid `best` in each of `cohorts`, as `newest`; None without one.

    One lookup in an index for each cohort.
    """
    valid = SessionSummary.objects.filter(
        cohort=OuterRef("pk"),
        configuration__front=OuterRef("front"),
        configuration__name=BEST,
        state=State.VALID,
    )
    newest = valid.order_by("-session").values("session")[:1]
    return cohorts.annotate(newest=Subquery(newest)).values("newest")


def times_of_device(figure: Speedup, device: int) -> NewestTimes | None:
    """The newest times of `figure` of the device with the key `device`. One query."""
    cohort = Cohort.objects.filter(
        device=device,
        front__slug=figure.front,
        backend=figure.backend,
        processor=figure.processor,
        processor_class=figure.processor_class,
    )
    runs = Run.objects.filter(
        session__in=newest_sessions(cohort), state=State.VALID, configuration__name__in=(DEFAULT, BEST)
    )
    rows = list(runs.order_by().values_list("session__uuid", "configuration__name", "repeat", "mean_us"))
    if not rows:
        return None
    return _paired(rows[0][0], ((name, repeat, mean and mean * 1e-6) for _, name, repeat, mean in rows))


def _paired(session: UUID, runs: Iterable[tuple[str, int, float | None]]) -> NewestTimes | None:
    """The times over `runs` (configuration, repeat, seconds), of the repeats that both configurations
    have."""
    logs: dict[str, dict[int, float]] = {DEFAULT: {}, BEST: {}}
    for name, repeat, seconds in runs:
        if name in logs and seconds:
            logs[name][repeat] = math.log(seconds)
    pairs = logs[DEFAULT].keys() & logs[BEST].keys()
    if not pairs:
        return None
    default, best = (math.exp(fmean(logs[name][repeat] for repeat in pairs)) for name in (DEFAULT, BEST))
    return NewestTimes(session, default, best)
