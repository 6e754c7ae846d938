"""All summaries and figures anew, from the raw runs: after a change of the statistics, or of nothing at all.

It stops anywhere without harm: what it has not reached still waits, for the next start or for the workers,
which may do the same work at the same time.
"""

from collections.abc import Callable

from django.db.models import QuerySet

from crowd.results.figures import confirmation
from crowd.results.figures import sessions as session_figures
from crowd.results.models import MeasurementSession

PART = 2_000


def chosen(device: str | None = None, front: str | None = None) -> QuerySet[MeasurementSession]:
    """The sessions of a device and of a front, by their slugs; of all where neither is named."""
    sessions = MeasurementSession.objects.all()
    if device is not None:
        sessions = sessions.filter(device__slug=device)
    if front is not None:
        sessions = sessions.filter(front__slug=front)
    return sessions


def work(told: Callable[[int], None]) -> tuple[int, int]:
    """Summarise what waits, then compute the figures that this changed; how many sessions and cohorts.

    TOLD hears after each part how many sessions are done.
    """
    sessions = 0
    while done := session_figures.summarise_waiting(PART, figures=False):
        sessions += len(done)
        told(sessions)
    cohorts = session_figures.refresh_stale()
    confirmation.settle()
    return sessions, cohorts
