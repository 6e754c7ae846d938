"""The shape of a submission. Types are checked strictly while JSON is read, values run by run.

Runs stay undecoded at first, so that one with a wrong type costs nothing but itself. Unknown members are
ignored: a newer client may send more.
"""

import re
from datetime import datetime
from typing import Annotated, Any, Literal, TypeVar
from uuid import UUID

import msgspec

from crowd.problems import Problem

T = TypeVar("T")
SCHEMA_VERSION = 1
Text = Annotated[str, msgspec.Meta(max_length=200)]
Version = Annotated[str, msgspec.Meta(max_length=32)]
Small = Annotated[int, msgspec.Meta(ge=0, le=32_767)]
WHERE = re.compile(r" - at `\$(?P<path>[^`]*)`$")
OFFSET = re.compile(r"\(byte (?P<offset>\d+)\)$")
NOT_FINITE = re.compile(rb"-?(NaN|Infinity|inf)", re.IGNORECASE)


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


class Enrolment(msgspec.Struct):
    """Who asks for a token: a program and its version, never a person."""

    app: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    app_version: Version
    consent_version: Small


_SUBMISSION = msgspec.json.Decoder(Submission)
_ENROLMENT = msgspec.json.Decoder(Enrolment)
_RUN = msgspec.json.Decoder(Run)
_NAMED = msgspec.json.Decoder(_Named)


def submission(body: bytes) -> Submission:
    """BODY as a submission, its runs undecoded.

    Raises Problem: malformed_json, not_finite, null_character, unknown_schema_version or invalid_field.
    """
    return _decoded(_SUBMISSION, body)


def enrolment(body: bytes) -> Enrolment:
    """BODY as an enrolment. Raises Problem as `submission` does."""
    return _decoded(_ENROLMENT, body)


def run(raw: msgspec.Raw) -> Run:
    """RAW as a run. Raises Problem with the member in `field`, from the run on (`frame_us[3]`)."""
    return _decoded(_RUN, bytes(raw))


def id_of(raw: msgspec.Raw) -> str | None:
    """The id that a run names, even where the rest of it is wrong; None where it names none."""
    try:
        name = _NAMED.decode(raw).id
    except (msgspec.DecodeError, RecursionError):
        return None
    return name if isinstance(name, str) and len(name) <= 64 else None


def _decoded(decoder: "msgspec.json.Decoder[T]", body: bytes) -> T:
    # PostgreSQL stores no NUL in text, and no device's name has one.
    if b"\\u0000" in body:
        raise Problem(400, "null_character", "a text holds the character NUL (\\u0000): leave it out")
    try:
        return decoder.decode(body)
    except msgspec.ValidationError as error:
        raise _wrong_type(str(error)) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _malformed(str(error), body) from error


def _wrong_type(message: str) -> Problem:
    where = WHERE.search(message)
    field = where["path"].lstrip(".") if where else None
    text = message[: where.start()] if where else message
    if field == "schema_version":
        return Problem(
            400, "unknown_schema_version", f"this server reads schema_version {SCHEMA_VERSION}", field=field
        )
    if text == "Number out of range":
        return Problem(400, "not_finite", f"{text}: infinite numbers are not JSON", field=field)
    return Problem(400, "invalid_field", text, field=field)


def _malformed(message: str, body: bytes) -> Problem:
    offset = OFFSET.search(message)
    if offset and NOT_FINITE.match(body, int(offset["offset"])):
        return Problem(
            400,
            "not_finite",
            f"NaN and infinite numbers are not JSON; write null, or leave it out ({message})",
        )
    return Problem(400, "malformed_json", message)
