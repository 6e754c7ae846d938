"""Leases on evaluations: workers take, renew and return them, and lose them when they stop renewing.

A device never has more live leases than machines, so that measurements do not disturb each other. The clocks
of machines that share a database must agree within a fraction of a lease.
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
    result_columns,
)
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from slam.public_text import one_line
from wire.evaluation import as_measured

UNFINISHED = (Evaluation.State.PENDING, Evaluation.State.RUNNING)
RETRY_SECONDS = 0.5
DEVICE = "exploration__reference_device"
T = TypeVar("T")

log = logging.getLogger(__name__)


class DeviceBusyError(RuntimeError):
    """All machines of the device are busy. The message names the device."""


@contextmanager
def leased(evaluation_id: int, worker: str = "") -> Iterator[Evaluation | None]:
    """Lease the evaluation for the block; None if it is not available, as in `take`.

    Waits for a busy device for at most the duration of a lease. An exception of the measurement makes it a
    failed evaluation with a reason. A shutdown of the process returns it. A CannotMeasureHereError returns
    it, is noted on the exploration, and is raised. After a database error, the reaper handles it.
    """
    evaluation = _take_when_free(evaluation_id, worker or workers.worker_name())
    if evaluation is None:
        yield None
        return
    try:
        yield evaluation
    except MeasurementError as error:
        fail(evaluation, str(error))
    except CannotMeasureHereError as error:
        log.error("%s cannot be measured on this machine and is returned: %s", evaluation, error)
        return_evaluation(evaluation, str(error))
        raise
    except LeaseLostError:
        log.warning("the lease on %s is lost: another worker has it, or it was cancelled", evaluation)
    except Error:
        raise
    except Exception as error:
        log.exception("%s could not be measured", evaluation)
        fail(evaluation, f"{type(error).__name__}: {error}")
    except BaseException:
        return_evaluation(evaluation)
        raise


def take(evaluation_id: int, worker: str) -> Evaluation | None:
    """Lease the evaluation; None if it is finished, leased by another worker, or paused.

    Raises DeviceBusyError.
    """
    with transaction.atomic():
        # Only the device is locked, as in take_next: of two workers, the second sees what the first took. An
        # evaluation that changed since it was read is not leased.
        evaluation = queries.read_and_lock(evaluation_id)
        if evaluation is None:
            return None
        if evaluation.exploration.state != Exploration.State.RUNNING or not _is_available(evaluation):
            return None
        if (leased := _lease(evaluation, worker)) is not None:
            return leased
        device = evaluation.exploration.reference_device
        if free_machines(device) < 1:
            raise DeviceBusyError(f"{device}: all of its {device.machines} machines are busy")
        return None


def _take_when_free(evaluation_id: int, worker: str) -> Evaluation | None:
    limit = time.monotonic() + _duration().total_seconds()
    while True:
        try:
            return take(evaluation_id, worker)
        except DeviceBusyError as busy:
            if time.monotonic() > limit:
                log.warning("evaluation %s waits for the reaper: %s", evaluation_id, busy)
                return None
        time.sleep(RETRY_SECONDS)


def take_next(device: ReferenceDevice, worker: str, among: Q) -> Evaluation | None:
    """Lease the oldest pending evaluation of `device`; None without one, or if all its machines are busy.

    `among`: a condition that the evaluation must meet.
    """
    with transaction.atomic():
        locked = ReferenceDevice.objects.select_for_update().get(pk=device.pk)
        ReferenceDevice.objects.filter(pk=device.pk).update(seen_at=timezone.now())
        pending = pending_for(locked).filter(among).select_related(DEVICE)
        while free_machines(locked) >= 1 and (evaluation := pending.first()) is not None:
            # If a late result finished it since it was read, take the next one.
            if _lease(evaluation, worker) is not None:
                return evaluation
        return None


def explorations_with_work(device: ReferenceDevice) -> list[Exploration]:
    """The running explorations with pending evaluations for `device`, oldest first."""
    pending = Evaluation.objects.filter(exploration=OuterRef("pk"), state=Evaluation.State.PENDING)
    running = Exploration.objects.filter(Exists(pending), state=Exploration.State.RUNNING)
    return list(running.filter(reference_device=device).order_by("pk"))


def pending_for(device: ReferenceDevice) -> QuerySet[Evaluation]:
    """The pending evaluations that a client can measure for `device`, those of the oldest exploration first.

    References need all devices of one machine: a worker of this server measures them.
    """
    return (
        Evaluation.objects.filter(
            state=Evaluation.State.PENDING,
            exploration__state=Exploration.State.RUNNING,
            exploration__reference_device=device,
        )
        .exclude(phase=Evaluation.Phase.REFERENCE)
        .order_by("exploration_id", "number")
    )


def free_machines(device: ReferenceDevice) -> int:
    """The number of machines of `device` without a live lease."""
    return device.machines - queries.count_live_leases(device.pk, timezone.now())


def renew(evaluation: Evaluation) -> bool:
    """Renew the lease; False if it is lost.

    While the database does not respond, returns True: the next renewal will tell.
    """
    now = timezone.now()
    try:
        return bool(_held(evaluation).update(lease_until=now + _duration(), heartbeat_at=now))
    except (OperationalError, InterfaceError) as error:
        log.warning("the lease on %s cannot be renewed now: %s", evaluation, error)
        connection.close()
        return True


def renew_all() -> None:
    """Begin each lease again, as a server starts: its workers could not renew them, and may be measuring."""
    running = Evaluation.objects.filter(state=Evaluation.State.RUNNING)
    running.update(lease_until=timezone.now() + _duration())


def record(evaluation: Evaluation, measurement: Measurement, measured_by: str = "") -> bool:
    """Store a measurement; False, and nothing stored, if another worker has or finished the evaluation.

    `measured_by`: the version of the software, if it is not that of this process.
    """
    stored = _finish(
        evaluation,
        state=Evaluation.State.DONE,
        software=measured_by or software.software_version(),
        **as_measured(measurement),
        **result_columns(evaluation, measurement),
    )
    exploration = evaluation.exploration
    if stored and exploration.note:
        # It can be measured after all. A newer note, of a search that paused itself, stays.
        _noted(exploration).filter(note=exploration.note).update(note="")
    return stored


def fail(evaluation: Evaluation, reason: str, measured_by: str = "") -> bool:
    """Store that the measurement failed; False as in `record`."""
    return _finish(
        evaluation,
        state=Evaluation.State.FAILED,
        error=one_line(reason) or "no reason given",
        software=measured_by or software.software_version(),
    )


def return_evaluation(evaluation: Evaluation, reason: str = "") -> bool:
    """Return it to the pending evaluations; False if the lease is lost. This does not count as a loss.

    `reason`, why this machine cannot measure it, becomes the exploration's note.
    """
    given = bool(_held(evaluation).update(state=Evaluation.State.PENDING, lease_until=None))
    if given and reason:
        device = evaluation.exploration.reference_device
        _noted(evaluation.exploration).update(
            note=f"a machine of {device} cannot measure: {one_line(reason)}"
        )
    return given


def find_held(device: ReferenceDevice, evaluation_id: int, attempt: int) -> Evaluation | None:
    """The unfinished evaluation of `device` whose latest lease is number `attempt`; None without one.

    That lease may have expired. Until another worker begins, its result is still accepted: the same worker
    could take the evaluation again and send the same. Refusing it would only cost minutes of measuring
    after each break of a line.
    """
    return (
        Evaluation.objects.select_related(DEVICE)
        .filter(
            pk=evaluation_id,
            attempt=attempt,
            attempt__gte=1,
            state__in=UNFINISHED,
            exploration__reference_device=device,
        )
        .first()
    )


def _lease(evaluation: Evaluation, worker: str) -> Evaluation | None:
    """Lease `evaluation`; None if it changed since it was read, or if no machine is free."""
    now = timezone.now()
    until = now + _duration()
    if not queries.lease(evaluation, worker[:200], now, until):
        return None
    evaluation.state, evaluation.lease_until = Evaluation.State.RUNNING, until
    evaluation.attempt += 1
    return evaluation


def _finish(evaluation: Evaluation, **values: Any) -> bool:
    # The result of an expired lease is accepted as in `find_held`.
    return _with_retries(lambda: queries.finish(evaluation, timezone.now(), **values), _duration())


def _with_retries(write: Callable[[], T], patience: timedelta) -> T:
    """The result of `write`, retried while the database does not respond: a measurement takes minutes."""
    limit = time.monotonic() + patience.total_seconds()
    while True:
        try:
            return write()
        except (OperationalError, InterfaceError) as error:
            # Inside a transaction, nothing can be retried.
            if connection.in_atomic_block or time.monotonic() > limit:
                raise
            log.warning("a result cannot be stored now and will be retried: %s", error)
            connection.close()
            time.sleep(RETRY_SECONDS)


def _held(evaluation: Evaluation) -> QuerySet[Evaluation]:
    """The row of `evaluation`, if its lease is still held."""
    return Evaluation.objects.filter(
        pk=evaluation.pk, state=Evaluation.State.RUNNING, attempt=evaluation.attempt
    )


def _noted(exploration: Exploration) -> QuerySet[Exploration]:
    """The row of a running `exploration`: only its note may be changed by measurements."""
    return Exploration.objects.filter(pk=exploration.pk, state=Exploration.State.RUNNING)


def _is_available(evaluation: Evaluation) -> bool:
    if evaluation.state == Evaluation.State.RUNNING:
        return evaluation.lease_until is not None and evaluation.lease_until < timezone.now()
    return evaluation.state == Evaluation.State.PENDING


def _duration() -> timedelta:
    return timedelta(seconds=settings.FRONTRUNNER_LEASE_SECONDS)
