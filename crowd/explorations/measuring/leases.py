"""Who measures what: leases on evaluations, taken in one transaction, renewed, and lost with their worker.

A device never has more live leases than machines, so that nobody disturbs another's timings. Clocks of
machines that share a database must agree to within a fraction of a lease.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, TypeVar

from django.conf import settings
from django.db import Error, InterfaceError, OperationalError, connection, transaction
from django.db.models import Exists, OuterRef, Q, QuerySet
from django.utils import timezone

from crowd.explorations.measuring import queries, software, workers
from crowd.explorations.measuring.measurement import (
    CannotMeasureHereError,
    LeaseLostError,
    Measurement,
    MeasurementError,
    outcome,
)
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from slam.public_text import one_line

UNFINISHED = (Evaluation.State.PENDING, Evaluation.State.RUNNING)
ASK_AGAIN_SECONDS = 0.5
DEVICE = "exploration__reference_device"
T = TypeVar("T")

log = logging.getLogger(__name__)


class DeviceBusyError(RuntimeError):
    """All machines of the device measure; the message names it."""


@contextmanager
def leased(evaluation_id: int, worker: str = "") -> Iterator[Evaluation | None]:
    """The evaluation, held for as long as it is measured; None where it is not to be had, as in `take`.

    While the device is busy it is waited for, up to as long as a lease lasts. Any exception of the
    measurement makes it a failed evaluation with its reason. Where the process is asked to end it is given
    back; trouble with the database leaves it to the reaper. A CannotMeasureHereError
    gives it back too, says so in the exploration's note, and is raised.
    """
    evaluation = _take_in_turn(evaluation_id, worker or workers.here())
    if evaluation is None:
        yield None
        return
    try:
        yield evaluation
    except MeasurementError as error:
        fail(evaluation, str(error))
    except CannotMeasureHereError as error:
        log.error("%s cannot be measured on this machine, it is given back: %s", evaluation, error)
        give_back(evaluation, str(error))
        raise
    except LeaseLostError:
        log.warning("%s is measured by someone else by now, or no longer wanted", evaluation)
    except Error:
        raise
    except Exception as error:
        log.exception("%s could not be measured", evaluation)
        fail(evaluation, f"{type(error).__name__}: {error}")
    except BaseException:
        give_back(evaluation)
        raise


def take(evaluation_id: int, worker: str) -> Evaluation | None:
    """Lease the evaluation; None where it is finished, someone else's, or not wanted now.

    Raises DeviceBusyError.
    """
    with transaction.atomic():
        # The device alone is locked, as by take_next: of two of its workers the second sees what the first
        # took. Where the evaluation has changed since it was read it is not leased.
        evaluation = queries.to_be_taken(evaluation_id)
        if evaluation is None:
            return None
        if evaluation.exploration.state != Exploration.State.RUNNING or not _free(evaluation):
            return None
        if (leased := _lease(evaluation, worker)) is not None:
            return leased
        device = evaluation.exploration.reference_device
        if free_machines(device) < 1:
            raise DeviceBusyError(f"{device}: all of its {device.machines} machines measure")
        return None


def _take_in_turn(evaluation_id: int, worker: str) -> Evaluation | None:
    limit = time.monotonic() + _duration().total_seconds()
    while True:
        try:
            return take(evaluation_id, worker)
        except DeviceBusyError as busy:
            if time.monotonic() > limit:
                log.warning("evaluation %s waits for the reaper: %s", evaluation_id, busy)
                return None
        time.sleep(ASK_AGAIN_SECONDS)


def take_next(device: ReferenceDevice, worker: str, among: Q) -> Evaluation | None:
    """Lease what waits longest for DEVICE; None where nothing does, or all its machines are busy.

    AMONG is a condition on the evaluations: no other one is leased.
    """
    with transaction.atomic():
        locked = ReferenceDevice.objects.select_for_update().get(pk=device.pk)
        ReferenceDevice.objects.filter(pk=device.pk).update(seen_at=timezone.now())
        found = waiting(locked).filter(among).select_related(DEVICE)
        while free_machines(locked) >= 1 and (evaluation := found.first()) is not None:
            # Where a late result has finished it since it was read the next one is had.
            if _lease(evaluation, worker) is not None:
                return evaluation
        return None


def served(device: ReferenceDevice) -> list[Exploration]:
    """The explorations of which something waits for DEVICE, the oldest first."""
    pending = Evaluation.objects.filter(exploration=OuterRef("pk"), state=Evaluation.State.PENDING)
    running = Exploration.objects.filter(Exists(pending), state=Exploration.State.RUNNING)
    return list(running.filter(reference_device=device).order_by("pk"))


def waiting(device: ReferenceDevice) -> QuerySet[Evaluation]:
    """What is to be measured on DEVICE and nobody measures, the oldest exploration's first."""
    return Evaluation.objects.filter(
        state=Evaluation.State.PENDING,
        exploration__state=Exploration.State.RUNNING,
        exploration__reference_device=device,
    ).order_by("exploration_id", "number")


def free_machines(device: ReferenceDevice) -> int:
    """How many machines of DEVICE hold no live lease."""
    return device.machines - queries.held(device.pk, timezone.now())


def renew(evaluation: Evaluation) -> bool:
    """Hold the evaluation for longer; False where the lease is lost.

    While the database does not answer nothing is lost yet: the next renewal shows it.
    """
    now = timezone.now()
    try:
        return bool(_held(evaluation).update(lease_until=now + _duration(), heartbeat_at=now))
    except (OperationalError, InterfaceError) as error:
        log.warning("the lease on %s cannot be renewed now: %s", evaluation, error)
        connection.close()
        return True


def record(evaluation: Evaluation, measurement: Measurement, measured_by: str = "") -> bool:
    """Store a measurement; False, and nothing stored, where another holds or has finished the evaluation.

    MEASURED_BY is the software's version where it is not this process's own.
    """
    stored = _finish(
        evaluation,
        state=Evaluation.State.DONE,
        stages=measurement.stages,
        device=measurement.device,
        software=measured_by or software.version(),
        **outcome(evaluation, measurement),
    )
    exploration = evaluation.exploration
    if stored and exploration.note:
        # It can be measured after all. The note of a search that paused itself is a newer one, and stays.
        _noted(exploration).filter(note=exploration.note).update(note="")
    return stored


def fail(evaluation: Evaluation, reason: str, measured_by: str = "") -> bool:
    """Store that the configuration cannot be measured; False as for `record`."""
    return _finish(
        evaluation,
        state=Evaluation.State.FAILED,
        error=one_line(reason) or "no reason given",
        software=measured_by or software.version(),
    )


def give_back(evaluation: Evaluation, reason: str = "") -> bool:
    """Let another measure it; False where the lease is lost anyway. That does not count as a loss.

    REASON, why it cannot be measured where it was held, becomes the exploration's note.
    """
    given = bool(_held(evaluation).update(state=Evaluation.State.PENDING, lease_until=None))
    if given and reason:
        device = evaluation.exploration.reference_device
        _noted(evaluation.exploration).update(
            note=f"a machine of {device} cannot measure: {one_line(reason)}"
        )
    return given


def held(device: ReferenceDevice, evaluation_id: int, attempt: int) -> Evaluation | None:
    """The evaluation of DEVICE whose latest lease is number ATTEMPT and that is not finished, else None."""
    return (
        Evaluation.objects.select_related(DEVICE)
        .filter(
            pk=evaluation_id,
            attempt=attempt,
            state__in=UNFINISHED,
            exploration__reference_device=device,
        )
        .first()
    )


def _lease(evaluation: Evaluation, worker: str) -> Evaluation | None:
    """Hold EVALUATION; None where it is not any more as it was read, or no machine is free."""
    now = timezone.now()
    until = now + _duration()
    if not queries.lease(evaluation, worker[:200], now, until):
        return None
    evaluation.state, evaluation.lease_until = Evaluation.State.RUNNING, until
    evaluation.attempt += 1
    return evaluation


def _finish(evaluation: Evaluation, **values: Any) -> bool:
    # A lease that ran out and that nobody took since loses nothing: what was measured is as good as ever.
    return _patiently(lambda: queries.finish(evaluation, timezone.now(), **values), _duration())


def _patiently(write: Callable[[], T], patience: timedelta) -> T:
    """What WRITE gives, tried again while the database does not answer: what was measured took minutes."""
    limit = time.monotonic() + patience.total_seconds()
    while True:
        try:
            return write()
        except (OperationalError, InterfaceError) as error:
            # Within somebody's transaction nothing can be tried again.
            if connection.in_atomic_block or time.monotonic() > limit:
                raise
            log.warning("a result cannot be stored now, it is kept and tried again: %s", error)
            connection.close()
            time.sleep(ASK_AGAIN_SECONDS)


def _held(evaluation: Evaluation) -> QuerySet[Evaluation]:
    """The row, if EVALUATION still holds its lease."""
    return Evaluation.objects.filter(
        pk=evaluation.pk, state=Evaluation.State.RUNNING, attempt=evaluation.attempt
    )


def _noted(exploration: Exploration) -> QuerySet[Exploration]:
    """The row, while measurements may change its note: a search that does not run has its own reason."""
    return Exploration.objects.filter(pk=exploration.pk, state=Exploration.State.RUNNING)


def _free(evaluation: Evaluation) -> bool:
    if evaluation.state == Evaluation.State.RUNNING:
        return evaluation.lease_until is not None and evaluation.lease_until < timezone.now()
    return evaluation.state == Evaluation.State.PENDING


def _duration() -> timedelta:
    return timedelta(seconds=settings.FRONTRUNNER_LEASE_SECONDS)
