"""Computes summaries and figures again from the raw runs.

It can be interrupted at any time. The remaining sessions wait for the next start, or for the workers, which
may do the same work at the same time.
"""

from collections.abc import Callable

from django.db.models import QuerySet

from crowd.results.figures import confirmation
from crowd.results.figures import sessions as session_figures
from crowd.results.figures.sessions import Part
from crowd.results.models import MeasurementSession

BATCH = 2_000


def select_sessions(device: str | None = None, front: str | None = None) -> QuerySet[MeasurementSession]:
    """The sessions of a device and of a front, by their slugs; without them, all sessions."""
    sessions = MeasurementSession.objects.all()
    if device is not None:
        sessions = sessions.filter(device__slug=device)
    if front is not None:
        sessions = sessions.filter(front__slug=front)
    return sessions


def recompute(report: Callable[[int], None], part: Part | None = None) -> tuple[int, int]:
    """Summarise waiting sessions, then compute their figures. Returns the number of sessions and of cohorts.

    Of a `part` only the sessions: figures depend on those of other devices, so they wait until all parts are
    done. `report` is called after each batch with the number of sessions done.
    """
    sessions = 0
    while done := session_figures.summarise_waiting(BATCH, figures=False, part=part):
        sessions += len(done)
        report(sessions)
    if part is not None:
        return sessions, 0
    cohorts = session_figures.refresh_stale()
    confirmation.update_chip_witnesses()
    return sessions, cohorts
