"""Leases over HTTP, for machines without Celery. Types are strict."""

from collections.abc import Iterable

import msgspec
from django.conf import settings
from django.db.models import Q

from crowd.explorations import result_checks, tasks
from crowd.explorations.measuring import contradictions, leases, measurement
from crowd.explorations.measuring.measurement import CannotMeasureHereError, Measurement
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.objectives import without_ratios
from crowd.explorations.searching.applications import application_of, measured_parameters
from crowd.fronts import responses
from crowd.http.decoding import decode_body
from crowd.http.problems import Problem
from wire.evaluation import as_measured
from wire.lease import LEASE_VERSION, Held, Lease, LeaseRequest, Result, Stored

_REQUEST = msgspec.json.Decoder(LeaseRequest)
_RESULT = msgspec.json.Decoder(Result)


def begin_lease(device: ReferenceDevice, body: bytes) -> Lease | None:
    """The next evaluation for `device`; None if none is pending, or if all its machines are busy.

    Raises Problem: 400 for an invalid body, 403 for the token of another device or of one that is set aside,
    409 if the client is too old, or if the server lacks the sequences of all pending evaluations.
    """
    request = decode_body(_REQUEST, body) if body else LeaseRequest()
    if request.device is not None and request.device != device.name:
        raise Problem(
            "another_device",
            f"this token belongs to {device.name}, not {request.device}",
            field="device",
        )
    if device.set_aside:
        raise Problem("device_set_aside", f"{device} gets no lease: {device.set_aside}; ask an administrator")
    if request.lease_version != LEASE_VERSION:
        raise Problem(
            "client_outdated",
            f"lease_version is {request.lease_version}: update this client (it must send {LEASE_VERSION})",
            field="lease_version",
        )
    possible, lacking = _possible_evaluations(leases.explorations_with_work(device))
    evaluation = leases.take_next(device, request.worker or device.name, possible)
    if evaluation is not None:
        return _lease(evaluation)
    waiting = leases.pending_for(device)
    if lacking is not None and waiting.exists() and not waiting.filter(possible).exists():
        raise lacking
    return None


def renew_lease(device: ReferenceDevice, key: int, attempt: int) -> Held:
    """Renew the lease. Raises Problem 410 if it is gone."""
    evaluation = leases.find_held(device, key, attempt)
    if evaluation is None or not leases.renew(evaluation):
        raise _gone()
    return Held(settings.FRONTRUNNER_LEASE_SECONDS)


def finish_lease(device: ReferenceDevice, key: int, attempt: int, body: bytes) -> Stored:
    """Store the result in `body`. The same result sent again gets the same response and changes nothing.

    Raises Problem 400 for an invalid body or impossible values, 409 if another result is stored, 410 if the
    lease is gone or was for another configuration: a restored database may use the same ids again.
    """
    result = decode_body(_RESULT, body)
    evaluation = leases.find_held(device, key, attempt)
    if evaluation is None:
        return _replay(device, key, attempt, result)
    if not _matches(result, evaluation) or not _store(evaluation, result):
        raise _gone()
    if not evaluation.exploration.measures_program:
        contradictions.compare(evaluation)
        tasks.follow_up(evaluation)
    states = {"done": "done", "failed": "failed", "returned": "pending"}
    return Stored(states[result.status])


def _store(evaluation: Evaluation, result: Result) -> bool:
    if result.status == "returned":
        return leases.return_evaluation(evaluation, result.error)
    if result.status == "failed":
        return leases.fail(evaluation, result.error, result.software)
    measured = _measured(evaluation, result)
    if evaluation.exploration.measures_program:
        result_checks.check_program(evaluation, result)
    else:
        result_checks.check_system(evaluation, result, measured)
    return leases.record(evaluation, measured, result.software)


def _measured(evaluation: Evaluation, result: Result) -> Measurement:
    if evaluation.exploration.measures_program:
        ended = {"stopped_at": result.stopped_at, "censored": result.censored}
        return Measurement(result.values or {}, parts=(ended,) if result.stopped_at else ())
    parts = tuple(part.stored for part in result.parts or [])
    return Measurement(result.objectives or {}, parts=parts, **as_measured(result))


def _matches(result: Result, evaluation: Evaluation) -> bool:
    """Whether `result` may be of `evaluation`.

    It has no configuration if the client cannot read the lease.
    """
    leased = measured_parameters(evaluation.exploration, evaluation.configuration)
    return result.configuration is None or result.configuration == leased


def _replay(device: ReferenceDevice, key: int, attempt: int, result: Result) -> Stored:
    finished = (Evaluation.State.DONE, Evaluation.State.FAILED)
    row = Evaluation.objects.filter(
        pk=key, attempt=attempt, state__in=finished, exploration__reference_device=device
    ).first()
    if row is None or not _matches(result, row):
        raise _gone()
    if not _is_stored(result, row):
        raise Problem("another_result", f"this lease has another result already: it is {row.state}")
    return Stored(row.state)


def _is_stored(result: Result, row: Evaluation) -> bool:
    """Whether `row` holds `result`. The ratios to the default in `row` are the server's."""
    if result.status != row.state or result.status == "failed":
        return result.status == row.state
    sent = measurement.result_columns(row, _measured(row, result))["objectives"]
    return bool(without_ratios(sent) == without_ratios(row.objectives or {}))


def _possible_evaluations(explorations: Iterable[Exploration]) -> tuple[Q, Problem | None]:
    """The evaluations of `explorations` whose sequences are here, and the first missing sequence.

    Repeats also run over held-out sequences.
    """
    possible, lacking = Q(pk__in=()), None
    for exploration in explorations:
        repeat = Q(exploration=exploration, phase=Evaluation.Phase.REPEAT)
        other = Q(exploration=exploration) & ~Q(phase=Evaluation.Phase.REPEAT)
        learned = exploration.learned_on
        for names, rows in ((learned, other), ([*learned, *exploration.held_out_sequences], repeat)):
            try:
                measurement.find_packs(exploration, names)
            except CannotMeasureHereError as error:
                lacking = lacking or Problem("sequence_missing", f"the server has {error}")
            else:
                possible |= rows
    return possible, lacking


def _lease(evaluation: Evaluation) -> Lease:
    exploration = evaluation.exploration
    return Lease(
        id=f"{evaluation.pk}-{evaluation.attempt}",
        application=application_of(exploration, evaluation.configuration),
        configuration=measured_parameters(exploration, evaluation.configuration),
        frames=evaluation.frames,
        backend=exploration.reference_device.backend,
        opencl_device=exploration.reference_device.opencl_device,
        sequences=tuple(responses.sequence(pack) for _, pack in measurement.packs_for(evaluation)),
        perturbation=evaluation.perturbation,
        stop_above=tuple(evaluation.stop_above),
        stop_after=measurement.stop_after(evaluation),
        learned_on=len(exploration.learned_on),
        objectives=tuple(exploration.objectives),
        maximised=tuple(exploration.options.get("maximised", ())),
        feasible=exploration.options.get("feasible"),
        lease_seconds=settings.FRONTRUNNER_LEASE_SECONDS,
        heartbeat_seconds=settings.FRONTRUNNER_HEARTBEAT_SECONDS,
        timeout_seconds=settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS,
        grace_seconds=exploration.options.get("grace_seconds", 0.0),
    )


def _gone() -> Problem:
    return Problem(
        "lease_gone",
        "this lease is not the running one: the evaluation was given to another machine, or cancelled. Drop "
        "the result",
    )
