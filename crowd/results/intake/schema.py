"""The shape of a submission. Types are checked strictly while JSON is read, values run by run.

Runs stay undecoded at first, so that one with a wrong type costs nothing but itself. Unknown members are no
error, a newer client may send more: `crowd.results.intake.checking.unknown_members` keeps them.
"""

from datetime import datetime
from typing import Annotated, Any, Literal
from uuid import UUID

import msgspec

from crowd.decoding import decoded
from crowd.problems import Problem

SCHEMA_VERSION = 1
Text = Annotated[str, msgspec.Meta(max_length=200)]
Version = Annotated[str, msgspec.Meta(max_length=32)]
Small = Annotated[int, msgspec.Meta(ge=0, le=32_767)]


class Run(msgspec.Struct):
    """One configuration over the sequence: microseconds, metres."""

    id: UUID
    configuration: Text
    repeat: Small
    order: Small
    status: Literal["ok", "failed"]
    frame_us: list[int]
    failure: Annotated[str, msgspec.Meta(max_length=500)] | None = None
    stages_us: dict[Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")], list[int]] | None = None
    tracked: list[bool | None] | Small | None = None
    ate_max: float | None = None
    ate_mean: float | None = None
    ate_rmse: float | None = None
    trajectory_sha256: Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}$")] | None = None


class Sample(msgspec.Struct):
    """The device's state t seconds after the start; null where the platform hides it."""

    t: Annotated[float, msgspec.Meta(ge=0)]
    temperature_c: float | None = None
    cpu_mhz: float | None = None
    battery: float | None = None


class Session(msgspec.Struct):
    """Runs measured one after another under one front's protocol."""

    id: UUID
    started_at: Annotated[datetime, msgspec.Meta(tz=True)]
    application: Text
    front_version: Text
    protocol_version: Small
    backend: Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9][a-z0-9._-]{0,31}$")]
    runs: list[msgspec.Raw]
    samples: Annotated[list[Sample], msgspec.Meta(max_length=5_000)] = []


class _Named(msgspec.Struct):
    id: Any = None


class Submission(msgspec.Struct):
    """Everything in one request."""

    schema_version: Literal[1]
    app_version: Version
    consent_version: Small
    device: dict[str, Any]
    sessions: Annotated[list[Session], msgspec.Meta(max_length=50)]
    # Whether the device's model may be named however rare it is; absent: as this installation said before.
    show_model: bool | None = None


class Enrolment(msgspec.Struct):
    """Who asks for a token: a program and its version, never a person."""

    app: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    app_version: Version
    consent_version: Small
    # An administrator's permit to send what nobody measured (crowd.devices.permits).
    simulated: Text | None = None


_SUBMISSION = msgspec.json.Decoder(Submission)
_ENROLMENT = msgspec.json.Decoder(Enrolment)
_RUN = msgspec.json.Decoder(Run)
_NAMED = msgspec.json.Decoder(_Named)


def submission(body: bytes) -> Submission:
    """BODY as a submission, its runs undecoded.

    Raises Problem: malformed_json, not_finite, null_character, unknown_schema_version or invalid_field.
    """
    try:
        return decoded(_SUBMISSION, body)
    except Problem as problem:
        if problem.field != "schema_version":
            raise
        readable = f"this server reads schema_version {SCHEMA_VERSION}"
        raise Problem(400, "unknown_schema_version", readable, field=problem.field) from problem


def enrolment(body: bytes) -> Enrolment:
    """BODY as an enrolment. Raises Problem as `submission` does."""
    return decoded(_ENROLMENT, body)


def run(raw: msgspec.Raw) -> Run:
    """RAW as a run. Raises Problem with the member in `field`, from the run on (`frame_us[3]`)."""
    return decoded(_RUN, bytes(raw))


def id_of(raw: msgspec.Raw) -> str | None:
    """The id that a run names, even where the rest of it is wrong; None where it names none."""
    try:
        name = _NAMED.decode(raw).id
    except (msgspec.DecodeError, RecursionError):
        return None
    return name if isinstance(name, str) and len(name) <= 64 else None
