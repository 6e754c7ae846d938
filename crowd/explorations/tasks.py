"""Celery tasks: they take a row's key, and every one may run twice or never without harm.

Every new evaluation is announced once on its device's queue, quick ones several in a message. Where messages
were lost the queue is empty before everything is measured: then the reaper announces again what waits.
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
from crowd.explorations.measuring import graceful_shutdown, leases, reaping, task_batching
from crowd.explorations.measuring.measurement import CannotMeasureHereError, Measurement, evaluator
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice

BROKER_TIMEOUT_SECONDS = 2

log = logging.getLogger(__name__)


@shared_task
def advance(exploration_id: int) -> None:
    """Ask for more where that is due, and announce it."""
    if asked := services.advance(exploration_id):
        _announce(asked[0].exploration, asked)


@shared_task
def evaluate(*evaluation_ids: int) -> None:
    """Measure configurations in turn on this worker's device, but for those that someone else measures."""
    measured = [evaluation for key in evaluation_ids if (evaluation := _evaluated(key)) is not None]
    if measured:
        follow(measured[-1])


@shared_task
def reap() -> None:
    """Give back what dead workers held, and announce what no message announces any more."""
    for exploration in reaping.reap():
        if not _queued(exploration.reference_device.queue):
            dispatch(exploration)
        _ask_where_due(exploration)


def dispatch(exploration: Exploration) -> None:
    """Announce everything of the exploration that waits, as soon as an open transaction is over."""
    transaction.on_commit(partial(_dispatch, exploration))


def go_on(exploration: Exploration) -> None:
    """Announce what waits, and where that is due ask for more: after a pause, a larger budget, a restart."""
    dispatch(exploration)
    _ask_where_due(exploration)


def follow(evaluation: Evaluation) -> None:
    """EVALUATION is finished: where that is due its exploration asks for more."""
    _ask_where_due(evaluation.exploration)


@worker_ready.connect
def reap_at_start(sender: Any = None, **_: object) -> None:
    """A worker that starts looks for what was left behind, at once for what an earlier one here held."""
    queues = list(sender.app.amqp.queues.consume_from) if sender is not None else []
    ReferenceDevice.objects.filter(queue__in=queues).update(seen_at=timezone.now())
    for exploration in reaping.reap_after_restart():
        go_on(exploration)


def _evaluated(evaluation_id: int) -> Evaluation | None:
    """The evaluation, which was held and is finished now; None where it was not to be had."""
    # What cannot be measured here waits for another machine, or for the reaper to announce it again.
    with suppress(CannotMeasureHereError):
        with leases.leased(evaluation_id) as evaluation:
            if evaluation is not None:
                leases.record(evaluation, _measured(evaluation))
        return evaluation
    return None


def _measured(evaluation: Evaluation) -> Measurement:
    """Raises WorkerShutdown as soon as this process has to end."""

    def heartbeat() -> bool:
        with graceful_shutdown.measuring.held_off():
            return leases.renew(evaluation)

    with graceful_shutdown.measuring.allowed():
        return evaluator()(evaluation, heartbeat)


def _dispatch(exploration: Exploration) -> None:
    if exploration.state == Exploration.State.RUNNING:
        _announce(exploration, services.waiting(exploration))


def _announce(exploration: Exploration, evaluations: Sequence[Evaluation]) -> None:
    """Send their messages, up to the first that cannot be sent: the reaper sends the others later."""
    queue = exploration.reference_device.queue
    for keys in task_batching.messages(exploration, evaluations):
        if not _send(evaluate, *keys, queue=queue):
            return


def _ask_where_due(exploration: Exploration) -> None:
    transaction.on_commit(partial(_advance_where_due, exploration))


def _advance_where_due(exploration: Exploration) -> None:
    if exploration.state == Exploration.State.RUNNING and services.due(exploration):
        _send(advance, exploration.pk)


def _queued(queue: str) -> int:
    """How many messages wait in QUEUE; 0 where there is no such queue yet, or no broker."""
    with current_app.connection_for_write(connect_timeout=BROKER_TIMEOUT_SECONDS) as broker:
        try:
            broker.ensure_connection(max_retries=1, timeout=BROKER_TIMEOUT_SECONDS)
            with broker.channel() as channel:
                return int(channel.queue_declare(queue=queue, passive=True).message_count)
        except (*broker.channel_errors, *broker.connection_errors, OperationalError):
            return 0


def _send(task: Task, *keys: int, queue: str | None = None) -> bool:
    """Whether it is sent. Without a broker the reaper does it later: nothing is raised."""
    try:
        task.apply_async(args=list(keys), retry=False, **({"queue": queue} if queue else {}))
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the reaper will send %s%s", error, task.name, keys)
        return False
    return True
