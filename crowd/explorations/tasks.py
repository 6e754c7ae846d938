"""Celery tasks: they take a row's key, and every one may run twice or never without harm."""

import logging

from celery import shared_task
from celery.signals import worker_ready
from kombu.exceptions import OperationalError

from crowd.explorations import services
from crowd.explorations.measurement import measure
from crowd.explorations.models import Evaluation

log = logging.getLogger(__name__)


@shared_task
def advance(exploration_id: int) -> None:
    """Ask for more once everything asked for is measured, and send it to the device."""
    for evaluation in services.advance(exploration_id):
        send(evaluation)


@shared_task
def evaluate(evaluation_id: int) -> None:
    """Measure one configuration on this worker's device, unless someone else already does."""
    with services.leased(evaluation_id) as evaluation:
        if evaluation is None:
            return
        services.record(evaluation, measure(evaluation, lambda: services.renew(evaluation)))
    advance.apply_async(args=[evaluation.exploration_id], retry=False)


@shared_task
def reap() -> None:
    """Send again what waits or was lost, in every exploration that runs."""
    for exploration in services.reap():
        for evaluation in services.waiting(exploration):
            send(evaluation)
        advance.apply_async(args=[exploration.pk], retry=False)


def send(evaluation: Evaluation) -> None:
    """Put EVALUATION on its device's queue. Without a broker the reaper does it later: nothing is raised."""
    queue = evaluation.exploration.reference_device.queue
    try:
        evaluate.apply_async(args=[evaluation.pk], queue=queue, retry=False)
    except (OperationalError, OSError) as error:
        log.warning("the broker does not answer (%s): the reaper will send %s", error, evaluation)


@worker_ready.connect
def reap_at_start(**_: object) -> None:
    """A worker that starts looks for what was left behind."""
    reap.apply_async(retry=False)
