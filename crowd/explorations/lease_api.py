"""Leases over HTTP: what a machine without Celery is asked for, and what it reports. Types are strict.

A client says in `lease_version` what it can do. Version 1 measures one sequence as it is. Version 2 measures
several sequences, changes depth, stops early and sends the parts of a result.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
from django.conf import settings
from django.db.models import Q

from crowd.explorations import tasks
from crowd.explorations.measuring import leases, measurement
from crowd.explorations.measuring.measurement import CannotMeasureHereError, Measurement
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.explorations.objectives import without_ratios
from crowd.fronts import responses
from crowd.http.decoding import decode_body
from crowd.http.problems import Problem

Text = Annotated[str, msgspec.Meta(max_length=200)]
Reason = Annotated[str, msgspec.Meta(max_length=500)]
Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
# Seconds, metres, bytes, joules: JSON has no infinite numbers, and none of these is negative.
Quantity = Annotated[float, msgspec.Meta(ge=0)]
Quantities = Annotated[dict[Name, Quantity], msgspec.Meta(max_length=64)]
Frames = Annotated[int, msgspec.Meta(ge=0)]
Description = Annotated[dict[Text, Reason | float | bool | None], msgspec.Meta(max_length=32)]
NEEDED = ("runtime", "ate_max")  # by every page, whatever an exploration minimises
SEVERAL = 2  # the lease_version from which a client measures several sequences and changes depth


class LeaseRequest(msgspec.Struct):
    """Who asks: the reference device that it takes itself for, and a name for people to tell it by.

    `lease_version` 2 says that this client measures all `sequences` of a lease, respects `perturbation`,
    `stop_above` and `stop_after`, and sends the `parts` of its result. Version 1 gets only evaluations that
    need none of these.
    """

    device: Text | None = None
    worker: Text = ""
    lease_version: Annotated[int, msgspec.Meta(ge=1)] = 1


class Lease(msgspec.Struct):
    """One evaluation, held for `lease_seconds` after each heartbeat.

    `sequences` are measured in this order; `sequence` is the first of them. `frames` to run of each, null for
    all. `perturbation` is the seed by which each depth is changed by one unit, 0 for none. After `stop_after`
    sequences with a largest error above `stop_above` (metres) no further one is run; where `stop_above` is
    null all are run. The result's objectives and stages are those of the first `learned_on` sequences. The
    others are held out: a camera lost there is a result, not a failure. `opencl_device` is a part of the
    description of a device of `backend`. A measurement fails after `timeout_seconds` for each sequence.
    """

    id: str
    application: str
    configuration: dict[str, Any]
    frames: int | None
    backend: str
    opencl_device: str
    sequence: responses.Sequence
    sequences: list[responses.Sequence]
    perturbation: int
    stop_above: float | None
    stop_after: int
    learned_on: int
    lease_seconds: float
    heartbeat_seconds: float
    timeout_seconds: float


class MeasuredPart(msgspec.Struct):
    """What was measured on one sequence: its name, how many frames were lost, the objectives."""

    sequence: Text
    lost: Frames
    objectives: Quantities


class Result(msgspec.Struct):
    """What became of it.

    `done` has `objectives` (seconds a frame, metres), `stages` (mean seconds a frame), the `device`, and in
    `parts` the same objectives of each sequence that was run (needed from `lease_version` 2 on);
    `failed` has an `error`; `returned` gives it back to be measured by another, and may say in `error` why
    this machine cannot. With the `configuration` that was measured, as the lease gave it, a result is not
    taken for another evaluation's.
    """

    status: Literal["done", "failed", "returned"]
    objectives: Quantities | None = None
    stages: Quantities | None = None
    device: Description | None = None
    parts: Annotated[list[MeasuredPart], msgspec.Meta(max_length=1000)] | None = None
    error: Reason = ""
    software: Annotated[str, msgspec.Meta(max_length=64)] = ""
    configuration: dict[str, Any] | None = None


class Held(msgspec.Struct):
    """The lease is held for so long from now on."""

    lease_seconds: float


class Stored(msgspec.Struct):
    """The state of the evaluation now."""

    state: str


_REQUEST = msgspec.json.Decoder(LeaseRequest)
_RESULT = msgspec.json.Decoder(Result)


def begin(device: ReferenceDevice, body: bytes) -> Lease | None:
    """The next evaluation for DEVICE, None where none waits or all its machines are busy.

    Raises Problem: 400 for a body that does not fit, 403 for another device's token, 409 where the server
    lacks the sequences of all that waits, or all that waits needs a newer client.
    """
    request = decode_body(_REQUEST, body) if body else LeaseRequest()
    if request.device is not None and request.device != device.name:
        raise Problem(
            "another_device",
            f"this token belongs to {device.name}, not {request.device}",
            field="device",
        )
    possible, lacking = _possible(leases.served(device), request.lease_version)
    evaluation = leases.take_next(device, request.worker or device.name, possible)
    if evaluation is not None:
        return _told(evaluation)
    waiting = leases.waiting(device)
    if waiting.exists() and not waiting.filter(possible).exists():
        raise lacking or _outdated()
    return None


def renew(device: ReferenceDevice, key: int, attempt: int) -> Held:
    """Hold the lease for longer. Raises Problem 410 where it is gone."""
    evaluation = leases.held(device, key, attempt)
    if evaluation is None or not leases.renew(evaluation):
        raise _gone()
    return Held(settings.FRONTRUNNER_LEASE_SECONDS)


def finish(device: ReferenceDevice, key: int, attempt: int, body: bytes) -> Stored:
    """Store what became of the evaluation. Told again, it is answered as before and changes nothing.

    Raises Problem 400 for a body that does not fit, 410 where the lease is gone, or was on another
    configuration: a database that was restored gives the same ids again.
    """
    result = decode_body(_RESULT, body)
    evaluation = leases.held(device, key, attempt)
    if evaluation is None:
        return _as_before(device, key, attempt, result)
    if not _fits(result, evaluation) or not _stored(evaluation, result):
        raise _gone()
    tasks.follow(evaluation)
    states = {"done": "done", "failed": "failed", "returned": "pending"}
    return Stored(states[result.status])


def _stored(evaluation: Evaluation, result: Result) -> bool:
    if result.status == "returned":
        return leases.give_back(evaluation, result.error)
    if result.status == "failed":
        return leases.fail(evaluation, result.error, result.software)
    objectives = result.objectives or {}
    _require(evaluation, objectives, "objectives")
    parts = [{"sequence": part.sequence, "lost": part.lost, **part.objectives} for part in result.parts or []]
    _check_parts(evaluation, parts)
    measured = Measurement(objectives, result.stages or {}, result.device or {}, tuple(parts))
    return leases.record(evaluation, measured, result.software)


def _require(evaluation: Evaluation, objectives: Mapping[str, Any], field: str, of: str = "") -> None:
    """Raise Problem 400 where OBJECTIVES lack what pages or EVALUATION's exploration need."""
    wanted = without_ratios(dict.fromkeys((*NEEDED, *evaluation.exploration.objectives)))
    if missing := [name for name in wanted if name not in objectives]:
        raise Problem("invalid_field", f"objectives{of} lack {', '.join(missing)}", field=field)


def _check_parts(evaluation: Evaluation, parts: Sequence[Mapping[str, Any]]) -> None:
    """Raise Problem 400 where PARTS are not those of EVALUATION's sequences, as its lease asked for them."""
    if not parts and measurement.is_plain(evaluation):
        return  # a client of version 1
    wanted = [pack["name"] for pack in measurement.names_for(evaluation)]
    measured = [part["sequence"] for part in parts]
    for name in measured:
        if name not in wanted or measured.count(name) > 1:
            raise Problem(
                "invalid_field",
                f"parts name {name}, {'twice' if name in wanted else 'which the lease does not'}: send one "
                f"part for each of {', '.join(wanted)}",
                field="parts",
            )
    for part in parts:
        _require(evaluation, part, "parts", f" of {part['sequence']}")
    missing = [name for name in wanted if name not in measured]
    if missing and not _stopped(evaluation, parts):
        raise Problem(
            "invalid_field",
            f"parts lack {', '.join(missing)}: measure every sequence of the lease until stop_after is "
            "reached; a client that sends no parts is too old, update it",
            field="parts",
        )


def _stopped(evaluation: Evaluation, parts: Iterable[Mapping[str, Any]]) -> bool:
    """Whether so many of PARTS are above the limit that no further sequence had to be run."""
    limit = measurement.stop_above(evaluation)
    if limit is None:
        return False
    return sum(part["ate_max"] > limit for part in parts) >= measurement.stop_after(evaluation)


def _fits(result: Result, evaluation: Evaluation) -> bool:
    """Whether RESULT may be EVALUATION's: an older client does not say what it measured."""
    return result.configuration is None or result.configuration == evaluation.configuration


def _as_before(device: ReferenceDevice, key: int, attempt: int, result: Result) -> Stored:
    finished = (Evaluation.State.DONE, Evaluation.State.FAILED)
    row = Evaluation.objects.filter(
        pk=key, attempt=attempt, state__in=finished, exploration__reference_device=device
    ).first()
    if row is None or not _fits(result, row):
        raise _gone()
    return Stored(row.state)


def _possible(explorations: Iterable[Exploration], version: int) -> tuple[Q, Problem | None]:
    """Which evaluations of EXPLORATIONS a client of VERSION can have; the first sequence that is not here.

    A repeat runs over the sequences held out, too.
    """
    possible, lacking = Q(pk__in=()), None
    for exploration in explorations:
        repeat = Q(exploration=exploration, phase=Evaluation.Phase.REPEAT)
        other = Q(exploration=exploration) & ~Q(phase=Evaluation.Phase.REPEAT)
        learned = exploration.learned_on
        for names, rows in ((learned, other), ([*learned, *exploration.held_out_sequences], repeat)):
            if version < SEVERAL and len(names) > 1:
                continue
            try:
                measurement.find_packs(exploration, names)
            except CannotMeasureHereError as error:
                lacking = lacking or Problem("sequence_missing", f"the server has {error}")
            else:
                possible |= rows
    return possible if version >= SEVERAL else possible & Q(perturbation=0), lacking


def _outdated() -> Problem:
    return Problem(
        "client_outdated",
        "all that waits runs over several sequences or changes depth, and this client cannot: update it "
        f"(it has to send lease_version {SEVERAL})",
    )


def _told(evaluation: Evaluation) -> Lease:
    exploration = evaluation.exploration
    sequences = [responses.sequence(pack) for _, pack in measurement.packs_for(evaluation)]
    return Lease(
        id=f"{evaluation.pk}-{evaluation.attempt}",
        application=exploration.application,
        configuration=evaluation.configuration,
        frames=evaluation.frames,
        backend=exploration.reference_device.backend,
        opencl_device=exploration.reference_device.opencl_device,
        sequence=sequences[0],
        sequences=sequences,
        perturbation=evaluation.perturbation,
        stop_above=measurement.stop_above(evaluation),
        stop_after=measurement.stop_after(evaluation),
        learned_on=len(exploration.learned_on),
        lease_seconds=settings.FRONTRUNNER_LEASE_SECONDS,
        heartbeat_seconds=settings.FRONTRUNNER_HEARTBEAT_SECONDS,
        timeout_seconds=settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS,
    )


def _gone() -> Problem:
    return Problem("lease_gone", "this lease ran out or its exploration was cancelled: drop the result")
