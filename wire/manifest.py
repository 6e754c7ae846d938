"""The manifest: what a server asks clients to measure, as GET /manifest answers it."""

from typing import Annotated

import msgspec
from msgspec import UNSET, UnsetType

from wire.front import Digest, Errors, Metres, Name, Predicted, Protocol, SequenceResult, Share

Size = Annotated[int, msgspec.Meta(ge=1)]


class ContentReference(msgspec.Struct, frozen=True):
    """Immutable content at `url`, relative to the server.

    It is JSON: a plan (slam/plans/schema.json), shaders (an object with the WGSL text of each kernel by
    name), or a trajectory (a list of [x, y, z] in metres, one per frame). Or it is a WebAssembly module.
    """

    sha256: Digest
    url: str


class WebAssembly(msgspec.Struct, frozen=True):
    """The plan of a frame in the rows layout, and the WebAssembly module with its kernels."""

    plan: ContentReference
    module: ContentReference


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """A point: its name, parameters, and predictions by the reference device (seconds per frame, metres).

    `backends`: those whose limits it keeps. `plan`: the plan of a frame for WebGPU; `shaders`: its kernels.
    `wasm`: the same for WebAssembly, absent if its buffers take 256 MiB or more.
    `band`: the allowed distance (m) of positions from the reference `trajectory`. `reference_ate`: the errors
    (m) of that trajectory; those of a run differ from them by at most twice its deviation. `skipped`: the
    share of the counted frames that the reference left out; absent for a configuration that computes every
    frame.
    Only in the detail of a front: `learned_on` and `held_out`, the worst results on sequences that the search
    used, and on sequences that it never saw.
    """

    name: Name
    parameters: dict[str, bool | int | float | str]
    predicted: Predicted
    backends: tuple[str, ...] | UnsetType = UNSET
    plan: ContentReference | UnsetType = UNSET
    shaders: ContentReference | UnsetType = UNSET
    wasm: WebAssembly | UnsetType = UNSET
    band: Metres | UnsetType = UNSET
    trajectory: ContentReference | UnsetType = UNSET
    reference_ate: Errors | UnsetType = UNSET
    skipped: Share | UnsetType = UNSET
    learned_on: tuple[SequenceResult, ...] | UnsetType = UNSET
    held_out: tuple[SequenceResult, ...] | UnsetType = UNSET


class Chunk(msgspec.Struct, frozen=True):
    """A part of the sequence. `url` is relative to the server; its content never changes."""

    sha256: Digest
    bytes: Size
    url: str


class Colour(msgspec.Struct, frozen=True):
    """The pack with the colour frames of a sequence."""

    name: str
    sha256: Digest
    chunks: tuple[Chunk, ...]


class Sequence(msgspec.Struct, frozen=True):
    """The pack to download: depth frames, camera, ground truth. `colour` is null if no colour is needed."""

    name: str
    sha256: Digest
    width: Size
    height: Size
    frames: Size
    volume_size: float | None
    initial_position: tuple[float, ...] | None
    chunks: tuple[Chunk, ...]
    colour: Colour | None


class Assignment(msgspec.Struct, frozen=True):
    """A configuration that this device is asked to measure, and the reason."""

    name: str
    why: str


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """What a client is asked to measure now.

    If `accepting` is false, measurements are not accepted now; `message` gives the reason, or is null.
    If an installation asks for additional work: `assigned`, and `assigned_message` with the reason if it is
    empty. `configurations` and `protocol` are then those of the additional session.
    """

    application: str
    front_version: str
    configurations: tuple[Configuration, ...]
    protocol: Protocol
    sequence: Sequence
    consent_version: int
    minimum_app_version: str
    accepting: bool
    message: str | None
    assigned: tuple[Assignment, ...] | UnsetType = UNSET
    assigned_message: str | UnsetType | None = UNSET
