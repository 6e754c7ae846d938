"""Celery tasks. Each may run twice, or be lost, without harm.

New evaluations are sent once to the queue of their device, quick ones several in a message. If messages were
lost, the queue is empty before everything is measured: then the reaper sends pending evaluations again.
"""

import logging
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from celery import Task, current_app, shared_task
from celery.signals import worker_ready
from django.db import transaction
from django.utils import timezone
from kombu.exceptions import OperationalError

from crowd.explorations import services
from crowd.explorations.measuring import (
    graceful_shutdown,
    leases,
    reaping,
    reference_devices,
    task_batching,
)
from crowd.explorations.measuring.measurement import CannotMeasureHereError, Measurement, evaluator
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice

BROKER_TIMEOUT_SECONDS = 2

log = logging.getLogger(__name__)


@shared_task
def advance(exploration_id: int) -> None:
    """Propose more evaluations if that is due, and send them."""
    if proposed := services.advance(exploration_id):
        _announce(proposed[0].exploration, proposed)


@shared_task
def evaluate(*evaluation_ids: int) -> None:
    """Measure configurations in turn on this worker's device, except those that another worker has."""
    measured = [evaluation for key in evaluation_ids if (evaluation := _evaluate_one(key)) is not None]
    if measured:
        follow_up(measured[-1])


@shared_task
def reap() -> None:
    """Return evaluations of lost workers, and send those whose message was lost."""
    for exploration in reaping.reap():
        if not _queued(_queue(exploration)):
            dispatch(exploration)
        _advance_on_commit(exploration)


def dispatch(exploration: Exploration) -> None:
    """Send all pending evaluations of the exploration after the current transaction."""
    transaction.on_commit(partial(_dispatch, exploration))


def continue_work(exploration: Exploration) -> None:
    """Send pending evaluations and propose more if due: after a pause, a larger budget, a restart."""
    dispatch(exploration)
    _advance_on_commit(exploration)


def follow_up(evaluation: Evaluation) -> None:
    """After `evaluation` is finished: propose more if its exploration is due."""
    _advance_on_commit(evaluation.exploration)


@worker_ready.connect
def reap_at_start(sender: Any = None, **_: object) -> None:
    """A starting worker returns evaluations of lost workers, and at once those of dead ones here."""
    queues = list(sender.app.amqp.queues.consume_from) if sender is not None else []
    ReferenceDevice.objects.filter(queue__in=queues).update(seen_at=timezone.now())
    for exploration in reaping.reap_after_restart():
        continue_work(exploration)


def _evaluate_one(evaluation_id: int) -> Evaluation | None:
    """Measure one evaluation; None if it was not available."""
    # An evaluation that cannot be measured here waits for another machine or for the reaper.
    with suppress(CannotMeasureHereError):
        with leases.leased(evaluation_id) as evaluation:
            if evaluation is not None:
                leases.record(evaluation, _measure(evaluation))
        return evaluation
    return None


def _measure(evaluation: Evaluation) -> Measurement:
    """Measure `evaluation`. Raises WorkerShutdown if this process shuts down."""

    def heartbeat() -> bool:
        with graceful_shutdown.shutdown.protected():
            return leases.renew(evaluation)

    with graceful_shutdown.shutdown.interruptible():
        return evaluator()(evaluation, heartbeat)


def _dispatch(exploration: Exploration) -> None:
    if exploration.state == Exploration.State.RUNNING:
        _announce(exploration, services.pending_evaluations(exploration))


def _announce(exploration: Exploration, evaluations: Sequence[Evaluation]) -> None:
    """Send `evaluations` until a message cannot be sent: the reaper sends the rest later."""
    queue = _queue(exploration)
    for keys in task_batching.messages(exploration, evaluations):
        if not _send(evaluate, *keys, queue=queue):
            return


def _queue(exploration: Exploration) -> str:
    """Where pending evaluations wait. A device that serves over HTTP leaves references to this machine."""
    device = exploration.reference_device
    if device.token_sha256 and exploration.prepares_id is not None:
        waiting = exploration.evaluations.filter(state=Evaluation.State.PENDING)
        if waiting.filter(phase=Evaluation.Phase.REFERENCE).exists():
            return reference_devices.THIS_MACHINE
    return device.queue


def _advance_on_commit(exploration: Exploration) -> None:
    transaction.on_commit(partial(_advance_if_due, exploration))


def _advance_if_due(exploration: Exploration) -> None:
    if exploration.state == Exploration.State.RUNNING and services.is_due(exploration):
        _send(advance, exploration.pk)


def _queued(queue: str) -> int:
    """The number of messages in `queue`; 0 without the queue or the broker."""
    with current_app.connection_for_write(connect_timeout=BROKER_TIMEOUT_SECONDS) as broker:
        try:
            broker.ensure_connection(max_retries=1, timeout=BROKER_TIMEOUT_SECONDS)
            with broker.channel() as channel:
                return int(channel.queue_declare(queue=queue, passive=True).message_count)
        except (*broker.channel_errors, *broker.connection_errors, OperationalError):
            return 0


def _send(task: Task, *keys: int, queue: str | None = None) -> bool:
    """Send `task`; returns whether that worked. Without a broker, the reaper sends it later."""
    try:
        task.apply_async(args=list(keys), retry=False, **({"queue": queue} if queue else {}))
    except (OperationalError, OSError) as error:
        log.warning("the broker does not respond (%s): the reaper will send %s%s", error, task.name, keys)
        return False
    return True
