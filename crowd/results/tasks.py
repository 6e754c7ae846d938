"""Celery tasks: they take a row's key, and every one may run twice or never without harm."""

import logging
from collections.abc import Iterable

from celery import shared_task
from celery.signals import worker_ready
from kombu.exceptions import OperationalError

from crowd.devices import decisions, recognition
from crowd.results.figures import refreshing, summarising
from crowd.results.opendata import exports
from crowd.results.privacy import publication

SWEEP_LIMIT = 2_000

log = logging.getLogger(__name__)


@shared_task
def summarise(session_id: int) -> None:
    """Turn one session into its summaries and its device's figures."""
    publication.settle([session_id])
    summarising.summarise_session(session_id)
    summarising.pulse("summarise")


@shared_task
def sweep() -> None:
    """Summarise what no message reached: after a lost broker, a killed worker, a new algorithm. Then compute
    the figures of devices with so many sessions that they are not computed for each.
    """
    recognition.renormalise_waiting()
    decisions.propose_aliases()
    publication.republish_waiting()
    publication.settle(summarising.summarise_waiting(SWEEP_LIMIT))
    refreshing.refresh_stale()
    summarising.pulse("sweep")


@shared_task
def republish(models: list[int]) -> None:
    """Put the sessions of MODELS under what the public sees of them now, and count them there."""
    publication.republish(models)
    summarising.summarise_waiting(SWEEP_LIMIT)


@shared_task
def export() -> None:
    """Write the open data once a night. Rewrite what is stale, delete what ended."""
    exports.make_if_due()


@shared_task
def rewrite_exports() -> None:
    """Remove what was erased from the files of the open data, before a reader has to wait for it."""
    exports.rewrite_all()


def announce(sessions: Iterable[int]) -> None:
    """Tell the workers of new sessions. Without a broker the sweep finds them later, so nothing is raised."""
    try:
        for key in sessions:
            summarise.apply_async(args=[key], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the next sweep finds the new sessions", error)


def announce_models(keys: list[int], **_: object) -> None:
    """Tell the workers of models that changed. Without a broker the sweep finds them later."""
    try:
        republish.apply_async(args=[keys], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the next sweep finds the changed models", error)


def announce_stale_files(**_: object) -> None:
    """Tell the workers that files of exports are stale. Without a broker readers and the next sweep do it."""
    try:
        rewrite_exports.apply_async(retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): stale files are rewritten when they are read", error)


@worker_ready.connect
def sweep_at_start(**_: object) -> None:
    """A worker that starts looks for what was left behind."""
    sweep.apply_async(retry=False)
