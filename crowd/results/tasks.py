"""Celery tasks: they take a row's key, and every one may run twice or never without harm."""

import logging
from collections.abc import Iterable

from celery import shared_task
from celery.signals import worker_ready
from kombu.exceptions import OperationalError

from crowd.results import summarising

SWEEP_LIMIT = 500

log = logging.getLogger(__name__)


@shared_task
def summarise(session_id: int) -> None:
    """Turn one session into its summaries and its device's figures."""
    summarising.summarise_session(session_id)
    summarising.pulse("summarise")


@shared_task
def sweep() -> None:
    """Summarise what no message reached: after a lost broker, a killed worker, a new algorithm."""
    summarising.summarise_waiting(SWEEP_LIMIT)
    summarising.pulse("sweep")


def announce(sessions: Iterable[int]) -> None:
    """Tell the workers of new sessions. Without a broker the sweep finds them later, so nothing is raised."""
    try:
        for key in sessions:
            summarise.apply_async(args=[key], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the next sweep finds the new sessions", error)


@worker_ready.connect
def sweep_at_start(**_: object) -> None:
    """A worker that starts looks for what was left behind."""
    sweep.apply_async(retry=False)
