"""Leases over HTTP: what a machine without Celery is told, and what it tells. Types are checked strictly."""

from typing import Annotated, Any, Literal

import msgspec
from django.conf import settings

from crowd.decoding import decoded
from crowd.explorations import leases, ratios, tasks
from crowd.explorations.measurement import CannotMeasureHereError, Measurement
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts import answers
from crowd.problems import Problem

Text = Annotated[str, msgspec.Meta(max_length=200)]
Reason = Annotated[str, msgspec.Meta(max_length=500)]
Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
# Seconds, metres, bytes, joules: JSON has no infinite numbers, and none of these is negative.
Quantity = Annotated[float, msgspec.Meta(ge=0)]
Quantities = Annotated[dict[Name, Quantity], msgspec.Meta(max_length=64)]
Description = Annotated[dict[Text, Reason | float | bool | None], msgspec.Meta(max_length=32)]
NEEDED = ("runtime", "ate_max")  # by every page, whatever an exploration minimises


class Wish(msgspec.Struct):
    """Who asks: the reference device that it takes itself for, and a name for people to tell it by."""

    device: Text | None = None
    worker: Text = ""


class Lease(msgspec.Struct):
    """One evaluation, held for `lease_seconds` after each heartbeat.

    `frames` to run, null for the whole sequence; `opencl_device` is a part of the description of a device of
    `backend`.
    """

    id: str
    application: str
    configuration: dict[str, Any]
    frames: int | None
    backend: str
    opencl_device: str
    sequence: answers.Sequence
    lease_seconds: float
    heartbeat_seconds: float
    timeout_seconds: float


class Result(msgspec.Struct):
    """What became of it.

    `done` has `objectives` (seconds a frame, metres), `stages` (mean seconds a frame) and the `device`;
    `failed` has an `error`; `returned` gives it back to be measured by another, and may say in `error` why
    this machine cannot. With the `configuration` that was measured, as the lease gave it, a result is not
    taken for another evaluation's.
    """

    status: Literal["done", "failed", "returned"]
    objectives: Quantities | None = None
    stages: Quantities | None = None
    device: Description | None = None
    error: Reason = ""
    software: Annotated[str, msgspec.Meta(max_length=64)] = ""
    configuration: dict[str, Any] | None = None


class Held(msgspec.Struct):
    """The lease is held for so long from now on."""

    lease_seconds: float


class Stored(msgspec.Struct):
    """The state of the evaluation now."""

    state: str


_WISH = msgspec.json.Decoder(Wish)
_RESULT = msgspec.json.Decoder(Result)


def begin(device: ReferenceDevice, body: bytes) -> Lease | None:
    """The next evaluation for DEVICE, None where none waits or all its machines are busy.

    Raises Problem: 400 for a body that does not fit, 403 for another device's token, 409 where the server
    lacks the sequences of all that waits.
    """
    wish = decoded(_WISH, body) if body else Wish()
    if wish.device is not None and wish.device != device.name:
        raise Problem(
            403, "another_device", f"this token belongs to {device.name}, not {wish.device}", field="device"
        )
    packs, lacking = _packs(leases.served(device))
    evaluation = leases.take_next(device, wish.worker or device.name, packs)
    if evaluation is None and lacking and not packs:
        raise Problem(409, "sequence_missing", f"the server has {lacking[0]}")
    return None if evaluation is None else _told(evaluation, packs[evaluation.exploration_id])


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
    result = decoded(_RESULT, body)
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
    wanted = ratios.without_claims(dict.fromkeys((*NEEDED, *evaluation.exploration.objectives)))
    if missing := [name for name in wanted if name not in objectives]:
        raise Problem(400, "invalid_field", f"objectives lack {', '.join(missing)}", field="objectives")
    measurement = Measurement(objectives, result.stages or {}, result.device or {})
    return leases.record(evaluation, measurement, result.software)


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


def _packs(explorations: list[Exploration]) -> tuple[dict[int, Any], list[CannotMeasureHereError]]:
    """The descriptions of their sequences by exploration, and why others have none."""
    packs, lacking = {}, []
    for exploration in explorations:
        try:
            packs[exploration.pk] = pack_of(exploration)[1]
        except CannotMeasureHereError as error:
            lacking.append(error)
    return packs, lacking


def _told(evaluation: Evaluation, pack: dict[str, Any]) -> Lease:
    exploration = evaluation.exploration
    return Lease(
        id=f"{evaluation.pk}-{evaluation.attempt}",
        application=exploration.application,
        configuration=evaluation.configuration,
        frames=evaluation.frames,
        backend=exploration.reference_device.backend,
        opencl_device=exploration.reference_device.opencl_device,
        sequence=answers.sequence(pack),
        lease_seconds=settings.FRONTRUNNER_LEASE_SECONDS,
        heartbeat_seconds=settings.FRONTRUNNER_HEARTBEAT_SECONDS,
        timeout_seconds=settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS,
    )


def _gone() -> Problem:
    return Problem(410, "lease_gone", "this lease ran out or its exploration was cancelled: drop the result")
