"""Celery tasks. Each may run twice, or be lost, without harm."""

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
from crowd.results.privacy import disclosure_sync

SWEEP_LIMIT = 2_000
# The least time between two messages about stale files, as a participant may erase runs one by one, and the
# longest time that a worker spends on one.
REWRITING_PAUSE_SECONDS = 60
REWRITING_SECONDS = 10.0

log = logging.getLogger(__name__)


@shared_task
def summarise(session_id: int) -> None:
    """Summarise one session and compute the figures of its device."""
    disclosure_sync.after_arrival([session_id])
    session_figures.summarise_session(session_id)
    session_figures.record_pulse("summarise")


@shared_task
def sweep() -> None:
    """Summarise the sessions whose message was lost, and all after a change of the statistics.

    Then compute the figures that are not computed for each session.
    """
    recognition.renormalise_waiting()
    decisions.propose_aliases()
    disclosure_sync.sync_disclosure(reassigning.reassign_sessions(reassigning.changed_models()))
    disclosure_sync.after_arrival(session_figures.summarise_waiting(SWEEP_LIMIT))
    session_figures.refresh_stale()
    confirmation.update_chip_witnesses()
    revision.prune()
    session_figures.record_pulse("sweep")


@shared_task
def reassign(models: list[int]) -> None:
    """Move the sessions of `models`, which were renamed, merged or split, to the models that they belong
    to."""
    disclosure_sync.sync_disclosure(reassigning.reassign_sessions(models))
    session_figures.summarise_waiting(SWEEP_LIMIT)


@shared_task
def export() -> None:
    """Write the open data once a night. Rewrite stale files, delete old exports."""
    exports.export_if_due()


@shared_task
def rewrite_exports() -> None:
    """Remove erased data from the files of the open data, so that readers need not wait for it."""
    exports.rewrite_all(REWRITING_SECONDS)


def announce(sessions: Iterable[int]) -> None:
    """Queue a task for each of `sessions`. Without a broker, the sweep finds them later."""
    try:
        for key in sessions:
            summarise.apply_async(args=[key], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not respond (%s): the next sweep finds the new sessions", error)


def announce_models(keys: list[int], **_: object) -> None:
    """Queue a task for the changed models `keys`. Without a broker, the sweep finds them later."""
    try:
        reassign.apply_async(args=[keys], retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not respond (%s): the next sweep finds the changed models", error)


def announce_stale_files(**_: object) -> None:
    """Queue a task that rewrites stale files, at most once in REWRITING_PAUSE_SECONDS.

    Other stale files are rewritten when they are read, and by the next `export`.
    """
    with counters.tolerate_failure("messages about stale files"):
        if counters.count("stale files", REWRITING_PAUSE_SECONDS).used > 1:
            return
    try:
        rewrite_exports.apply_async(retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not respond (%s): stale files are rewritten when they are read", error)


@worker_ready.connect
def sweep_at_start(**_: object) -> None:
    """A starting worker looks for unfinished work."""
    sweep.apply_async(retry=False)
