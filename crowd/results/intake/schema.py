"""The shape of a submission. Types are checked strictly while JSON is read, values run by run.

Sessions and runs stay undecoded at first: a run with a wrong type costs nothing but itself, and no more of
them is decoded than a submission may have. Unknown members are not an error, since a newer client may send
more: `crowd.results.intake.unknown_members` keeps them.
"""

from datetime import datetime
from typing import Annotated, Any, Literal
from uuid import UUID

import msgspec

from crowd.http.decoding import decoded, decoded_part, size_of
from crowd.http.problems import Problem

SCHEMA_VERSION = 1
MAX_SESSIONS = 50
MAX_DEVICE_BYTES = 16 << 10
MAX_ID_BYTES = 64
Text = Annotated[str, msgspec.Meta(max_length=200)]
# Numbers, and a suffix that has no room for words: versions are part of the open data.
Version = Annotated[
    str,
    msgspec.Meta(
        max_length=32,
        pattern=r"^[0-9]{1,6}(\.[0-9]{1,6}){0,4}([-+](a|b|rc|dev|post|alpha|beta)?\.?[0-9]{0,6}){0,2}$(?!\n)",
    ),
]
Program = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,31}$(?!\n)")]
Backend = Literal["opencl", "webgpu", "vulkan", "metal", "cuda", "cpu"]
Reading = float | msgspec.UnsetType | None
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
    """The device's state t seconds after the start; null or absent where the platform hides it."""

    t: Annotated[float, msgspec.Meta(ge=0)]
    temperature_c: Reading = msgspec.UNSET
    cpu_mhz: Reading = msgspec.UNSET
    battery: Reading = msgspec.UNSET


class Session(msgspec.Struct):
    """Runs measured one after another under one front's protocol."""

    id: UUID
    started_at: Annotated[datetime, msgspec.Meta(tz=True)]
    application: Text
    front_version: Text
    protocol_version: Small
    backend: Backend
    runs: list[msgspec.Raw]
    samples: Annotated[list[Sample], msgspec.Meta(max_length=5_000)] = []


class Submission(msgspec.Struct):
    """Everything in one request."""

    schema_version: Literal[1]
    app_version: Version
    consent_version: Small
    device: dict[str, Any]
    sessions: Annotated[list[Session], msgspec.Meta(max_length=MAX_SESSIONS)]
    # Whether the device's model may be named however rare it is; absent: as this installation said before.
    show_model: bool | None = None


class Enrolment(msgspec.Struct):
    """Who asks for a token: a program and its version, never a person."""

    app: Program
    app_version: Version
    consent_version: Small
    # An administrator's permit to send what nobody measured (crowd.devices.permits).
    simulated: Text | None = None


class _Envelope(Submission):
    """A submission whose larger parts are not decoded yet."""

    device: msgspec.Raw  # type: ignore[assignment]
    sessions: list[msgspec.Raw]  # type: ignore[assignment]


class _Identified(msgspec.Struct):
    id: msgspec.Raw = msgspec.Raw(b"null")


_ENVELOPE = msgspec.json.Decoder(_Envelope)
_DEVICE = msgspec.json.Decoder(dict[str, Any])
_SESSION = msgspec.json.Decoder(Session)
_ENROLMENT = msgspec.json.Decoder(Enrolment)
_RUN = msgspec.json.Decoder(Run)
_IDENTIFIED = msgspec.json.Decoder(_Identified)
_ANYTHING = msgspec.json.Decoder()


def submission(body: bytes) -> Submission:
    """BODY as a submission, its runs undecoded.

    Raises Problem 400: malformed_json, too_many_values, text_too_long, not_finite, null_character,
    unknown_schema_version, device_too_large or invalid_field.
    """
    envelope = _envelope(body)
    if (size := size_of(envelope.device)) > MAX_DEVICE_BYTES:
        text = f"device takes {size} bytes, at most {MAX_DEVICE_BYTES}"
        raise Problem(400, "device_too_large", text, field="device")
    if (count := len(envelope.sessions)) > MAX_SESSIONS:
        text = f"{count} sessions: send at most {MAX_SESSIONS}"
        raise Problem(400, "invalid_field", text, field="sessions")
    return Submission(
        schema_version=envelope.schema_version,
        app_version=envelope.app_version,
        consent_version=envelope.consent_version,
        device=decoded_part(_DEVICE, envelope.device, "device"),
        sessions=[
            decoded_part(_SESSION, raw, f"sessions[{place}]") for place, raw in enumerate(envelope.sessions)
        ],
        show_model=envelope.show_model,
    )


def _envelope(body: bytes) -> _Envelope:
    try:
        return decoded(_ENVELOPE, body)
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
    return decoded_part(_RUN, raw)


def id_of(raw: msgspec.Raw) -> str | None:
    """The id that a run names, even where the rest of it is wrong; None where it names none."""
    try:
        name = _IDENTIFIED.decode(raw).id
        if size_of(name) > MAX_ID_BYTES + len('""'):
            return None
        text = _ANYTHING.decode(name)
    except (msgspec.DecodeError, RecursionError):
        return None
    return text if isinstance(text, str) else None
