"""The schema of a submission. Types are checked strictly during decoding, values run by run.

Runs are decoded one by one: a wrong type rejects only its own run. Too many sessions are refused before they
are decoded. Unknown members are not an error, since a newer client may send more:
`crowd.results.intake.unknown_members` keeps them.
"""

from datetime import datetime
from typing import Annotated, Any, Literal
from uuid import UUID

import msgspec

from crowd.http.decoding import decode_body, decode_part, raw_size
from crowd.http.problems import Problem

SCHEMA_VERSION = 1
MAX_SESSIONS = 50
MAX_DEVICE_BYTES = 16 << 10
MAX_ID_BYTES = 64
MAX_FRAME_US = 60_000_000
MAX_PROCESSOR_US = 10**15
Text = Annotated[str, msgspec.Meta(max_length=200)]
# Numbers and a short suffix, so that no free text gets into the open data.
Version = Annotated[
    str,
    msgspec.Meta(
        max_length=32,
        pattern=r"^[0-9]{1,6}(\.[0-9]{1,6}){0,4}([-+](a|b|rc|dev|post|alpha|beta)?\.?[0-9]{0,6}){0,2}$(?!\n)",
    ),
]
Program = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,31}$(?!\n)")]
Backend = Literal["opencl", "webgpu", "wasm", "vulkan", "metal", "cuda", "cpu"]
OptionalReading = float | msgspec.UnsetType | None
Microseconds = Annotated[int, msgspec.Meta(ge=0, le=MAX_PROCESSOR_US)]
SmallInteger = Annotated[int, msgspec.Meta(ge=0, le=32_767)]
MAX_THREADS = 64


class Run(msgspec.Struct):
    """One run of a configuration over the sequence. Times are microseconds, errors metres.

    Over the counted frames: `cpu_us`, of the processor for all threads; `waited_us`, how long threads stood
    ready without one.
    """

    id: UUID
    configuration: Text
    repeat: SmallInteger
    order: SmallInteger
    status: Literal["ok", "failed"]
    frame_us: list[int]
    failure: Annotated[str, msgspec.Meta(max_length=500)] | None = None
    stages_us: dict[Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")], list[int]] | None = None
    tracked: list[bool | None] | SmallInteger | None = None
    ate_max: float | None = None
    ate_mean: float | None = None
    ate_rmse: float | None = None
    cpu_us: Microseconds | None = None
    waited_us: Microseconds | None = None
    deviation: (
        Annotated[
            float,
            msgspec.Meta(
                description="required where the status is ok: the largest distance (m) of a frame's position "
                "from the configuration's reference trajectory"
            ),
        ]
        | None
    ) = None


class Sample(msgspec.Struct):
    """The state of the device, t seconds after the start. Null or absent if the platform hides it."""

    t: Annotated[float, msgspec.Meta(ge=0)]
    temperature_c: OptionalReading = msgspec.UNSET
    cpu_mhz: OptionalReading = msgspec.UNSET
    battery: OptionalReading = msgspec.UNSET


class Session(msgspec.Struct):
    """Runs measured one after another by the protocol of one front.

    `empty_frame_us` and `stage_clock` are required, but sessions of another protocol than the front's lack
    them, and are refused for that. `blocks_repeated`: how often runs were measured again because other
    programs disturbed them.
    """

    id: UUID
    started_at: Annotated[datetime, msgspec.Meta(tz=True)]
    application: Text
    front_version: Text
    protocol_version: SmallInteger
    backend: Backend
    runs: list[msgspec.Raw]
    empty_frame_us: (
        Annotated[
            float,
            msgspec.Meta(
                ge=0,
                le=MAX_FRAME_US,
                description="required: microseconds that an empty frame costs on this backend",
            ),
        ]
        | None
    ) = None
    stage_clock: (
        Annotated[
            Literal["device", "wall", "none"],
            msgspec.Meta(description="required: what took the times of the stages; none: no stages"),
        ]
        | None
    ) = None
    threads: (
        Annotated[
            int,
            msgspec.Meta(
                ge=1,
                le=MAX_THREADS,
                description="required for the backend wasm, and null for others: how many threads computed, "
                "in all runs of the session",
            ),
        ]
        | None
    ) = None
    threads_claimed: (
        Annotated[
            SmallInteger,
            msgspec.Meta(description="how many processors a browser says it has, which may be untrue"),
        ]
        | None
    ) = None
    blocks_repeated: SmallInteger | None = None
    samples: Annotated[list[Sample], msgspec.Meta(max_length=5_000)] = []


class Submission(msgspec.Struct):
    """A request with measured sessions."""

    schema_version: Literal[1]
    app_version: Version
    consent_version: SmallInteger
    device: dict[str, Any]
    sessions: Annotated[list[Session], msgspec.Meta(max_length=MAX_SESSIONS)]
    # Whether a rare device model may be named in public; absent: as this installation said before.
    show_model: bool | None = None


class Enrolment(msgspec.Struct):
    """A request for a token, from a program and its version, never a person."""

    app: Program
    app_version: Version
    consent_version: SmallInteger


class _Envelope(Submission):
    """A submission whose device and sessions are not decoded yet."""

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


def decode_submission(body: bytes) -> Submission:
    """Decode `body`, a submission, but not its runs.

    Raises Problem 400: malformed_json, too_many_values, text_too_long, not_finite, null_character,
    unknown_schema_version, device_too_large or invalid_field.
    """
    envelope = _envelope(body)
    if (size := raw_size(envelope.device)) > MAX_DEVICE_BYTES:
        text = f"device takes {size} bytes, at most {MAX_DEVICE_BYTES}"
        raise Problem("device_too_large", text, field="device")
    if (count := len(envelope.sessions)) > MAX_SESSIONS:
        text = f"{count} sessions: send at most {MAX_SESSIONS}"
        raise Problem("invalid_field", text, field="sessions")
    return Submission(
        schema_version=envelope.schema_version,
        app_version=envelope.app_version,
        consent_version=envelope.consent_version,
        device=decode_part(_DEVICE, envelope.device, "device"),
        sessions=[
            decode_part(_SESSION, raw, f"sessions[{index}]") for index, raw in enumerate(envelope.sessions)
        ],
        show_model=envelope.show_model,
    )


def _envelope(body: bytes) -> _Envelope:
    try:
        return decode_body(_ENVELOPE, body)
    except Problem as problem:
        if problem.field != "schema_version":
            raise
        text = f"this server reads schema_version {SCHEMA_VERSION}"
        raise Problem("unknown_schema_version", text, field=problem.field) from problem


def decode_enrolment(body: bytes) -> Enrolment:
    """Decode `body`, an enrolment. Raises Problem as `decode_submission` does."""
    return decode_body(_ENROLMENT, body)


def decode_run(raw: msgspec.Raw) -> Run:
    """Decode `raw`, a run. Raises Problem with the member in `field`, relative to the run: `frame_us[3]`."""
    return decode_part(_RUN, raw)


def decode_id(raw: msgspec.Raw) -> str | None:
    """The id of `raw`, a run, even if the rest is invalid; None without a valid id."""
    try:
        name = _IDENTIFIED.decode(raw).id
        if raw_size(name) > MAX_ID_BYTES + len('""'):
            return None
        text = _ANYTHING.decode(name)
    except (msgspec.DecodeError, RecursionError):
        return None
    return text if isinstance(text, str) else None
