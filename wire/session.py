"""Sessions as clients submit them: POST /enrol and POST /submissions."""

from datetime import datetime
from typing import Annotated, Any, Final, Literal
from uuid import UUID

import msgspec

SCHEMA_VERSION: Final = 1
MAX_SESSIONS = 50
MAX_SAMPLES = 5_000
MAX_FRAME_US = 60_000_000
MAX_PROCESSOR_US = 10**15
MAX_THREADS = 64
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


class Run(msgspec.Struct, frozen=True, omit_defaults=True):
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


class Sample(msgspec.Struct, frozen=True):
    """The state of the device, t seconds after the start. Null or absent if the platform hides it."""

    t: Annotated[float, msgspec.Meta(ge=0)]
    temperature_c: OptionalReading = msgspec.UNSET
    cpu_mhz: OptionalReading = msgspec.UNSET
    battery: OptionalReading = msgspec.UNSET


class Session(msgspec.Struct, frozen=True, omit_defaults=True):
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
    runs: tuple[Run, ...]
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
    samples: Annotated[list[Sample], msgspec.Meta(max_length=MAX_SAMPLES)] = []


class Submission(msgspec.Struct, frozen=True, omit_defaults=True):
    """A request with measured sessions."""

    schema_version: Literal[1]
    app_version: Version
    consent_version: SmallInteger
    device: dict[str, Any]
    sessions: Annotated[list[Session], msgspec.Meta(max_length=MAX_SESSIONS)]
    # Whether a rare device model may be named in public; absent: as this installation said before.
    show_model: bool | None = None


class Enrolment(msgspec.Struct, frozen=True):
    """A request for a token, from a program and its version, never a person."""

    app: Program
    app_version: Version
    consent_version: SmallInteger
