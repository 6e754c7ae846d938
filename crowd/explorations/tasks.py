"""Celery tasks: they take a row's key, and every one may run twice or never without harm.

A device's queue holds no more messages than it has free machines: whoever finishes a measurement sends the
next. So nothing is measured after a pause, and a broker that loses its messages loses few.
"""

import logging
from typing import Any

from celery import Task, shared_task
from celery.signals import worker_ready
from django.utils import timezone
from kombu.exceptions import OperationalError

from crowd.explorations import leases, services
from crowd.explorations.measurement import evaluator
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice

log = logging.getLogger(__name__)


@shared_task
def advance(exploration_id: int) -> None:
    """Ask for more where that is due, and send what the device's free machines can take."""
    if services.advance(exploration_id):
        dispatch(Exploration.objects.select_related("reference_device").get(pk=exploration_id))


@shared_task
def evaluate(evaluation_id: int) -> None:
    """Measure one configuration on this worker's device, unless someone else already does."""
    with leases.leased(evaluation_id) as evaluation:
        if evaluation is None:
            return
        leases.record(evaluation, evaluator()(evaluation, lambda: leases.renew(evaluation)))
    follow(evaluation)


@shared_task
def reap() -> None:
    """Send again what waits or was lost, in every exploration that runs."""
    _restart(leases.reap())


def dispatch(exploration: Exploration) -> None:
    """Send as much of what waits for the exploration's device as it has free machines."""
    device = exploration.reference_device
    for key in leases.waiting(device).values_list("pk", flat=True)[: max(0, leases.free_machines(device))]:
        _send(evaluate, key, device.queue)


def go_on(exploration: Exploration) -> None:
    """Send what waits, and where that is due ask for more: after a pause, a larger budget, a restart."""
    dispatch(exploration)
    if exploration.state == Exploration.State.RUNNING and services.due(exploration):
        _send(advance, exploration.pk)


def follow(evaluation: Evaluation) -> None:
    """EVALUATION is finished: send the next one of its device, and let its exploration go on where due."""
    exploration = evaluation.exploration
    device = exploration.reference_device
    following = leases.waiting(device).values_list("pk", "exploration_id").first()
    if following is not None:
        _send(evaluate, following[0], device.queue)
    waits = following is not None and following[1] == exploration.pk and exploration.synchronous
    if not waits and services.due(exploration):
        _send(advance, exploration.pk)


@worker_ready.connect
def reap_at_start(sender: Any = None, **_: object) -> None:
    """A worker that starts looks for what was left behind, at once for what an earlier one here held."""
    queues = list(sender.app.amqp.queues.consume_from) if sender is not None else []
    ReferenceDevice.objects.filter(queue__in=queues).update(seen_at=timezone.now())
    _restart(leases.reap_after_restart())


def _restart(explorations: list[Exploration]) -> None:
    for exploration in explorations:
        go_on(exploration)


def _send(task: Task, key: int, queue: str | None = None) -> None:
    """Without a broker the reaper does it later: nothing is raised."""
    try:
        task.apply_async(args=[key], retry=False, **({"queue": queue} if queue else {}))
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the reaper will send %s(%s)", error, task.name, key)
