"""Celery tasks: they take a row's key, and every one may run twice or never without harm."""

import logging
from collections.abc import Iterable

from celery import shared_task
from celery.signals import worker_ready
from kombu.exceptions import OperationalError

from crowd.access import counters
from crowd.devices import recognition, revision
from crowd.devices.aliases import decisions
from crowd.results.figures import confirmation, reassigning
from crowd.results.figures import sessions as session_figures
from crowd.results.opendata import exports
from crowd.results.privacy import disclosure

SWEEP_LIMIT = 2_000
# How often a message about stale files is sent, and how long it may keep a worker from new sessions: a
# participant may erase runs one by one.
REWRITING_PAUSE_SECONDS = 60
REWRITING_SECONDS = 10.0

log = logging.getLogger(__name__)


@shared_task
def summarise(session_id: int) -> None:
    """Turn one session into its summaries and its device's figures."""
    disclosure.after_arrival([session_id])
    session_figures.summarise_session(session_id)
    session_figures.pulse("summarise")


@shared_task
def sweep() -> None:
    """Summarise what no message reached: after a lost broker, a killed worker, a new algorithm. Then compute
    the figures that are not computed for each session.
    """
    recognition.renormalise_waiting()
    decisions.propose_aliases()
    disclosure.sync_disclosure(reassigning.reassign_sessions(reassigning.changed_models()))
    disclosure.after_arrival(session_figures.summarise_waiting(SWEEP_LIMIT))
    session_figures.refresh_stale()
    confirmation.settle()
    revision.prune()
    session_figures.pulse("sweep")


@shared_task
def reassign(models: list[int]) -> None:
    """Store the sessions of MODELS, which were renamed, merged or split, under the models they belong to."""
    disclosure.sync_disclosure(reassigning.reassign_sessions(models))
    session_figures.summarise_waiting(SWEEP_LIMIT)


@shared_task
def export() -> None:
    """Write the open data once a night. Rewrite what is stale, delete what ended."""
    exports.make_if_due()


@shared_task
def rewrite_exports() -> None:
    """Remove what was erased from the files of the open data, before a reader has to wait for it."""
    exports.rewrite_all(REWRITING_SECONDS)


def announce(sessions: Iterable[int]) -> None:
    """Send the workers a message for each of SESSIONS. Without a broker the sweep finds them later."""
    try:
        for key in sessions:
            summarise.apply_async(args=[key], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the next sweep finds the new sessions", error)


def announce_models(keys: list[int], **_: object) -> None:
    """Send the workers a message about changed models. Without a broker the sweep finds them later."""
    try:
        reassign.apply_async(args=[keys], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the next sweep finds the changed models", error)


def announce_stale_files(**_: object) -> None:
    """Tell the workers that files of exports are stale, once in a while. What becomes stale meanwhile, or
    without a broker, is rewritten by readers and by the next `export`.
    """
    with counters.counting("messages about stale files"):
        if counters.count("stale files", REWRITING_PAUSE_SECONDS).used > 1:
            return
    try:
        rewrite_exports.apply_async(retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): stale files are rewritten when they are read", error)


@worker_ready.connect
def sweep_at_start(**_: object) -> None:
    """A worker that starts looks for what was left behind."""
    sweep.apply_async(retry=False)
