"""Structs of the API's answers about fronts."""

from collections.abc import Mapping
from collections.abc import Sequence as Several
from datetime import datetime
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from crowd.fronts.content import plans
from crowd.fronts.intake_policy import Policy
from slam.definitions import SYSTEMS
from wire.front import DEFAULT, Errors, Front, Point


class ContentReference(msgspec.Struct):
    """Immutable content at `url`, relative to the server.

    It is JSON: a plan (slam/plans/schema.json), shaders (an object with the WGSL text of each kernel by
    name), or a trajectory (a list of [x, y, z] in metres, one per frame). Or it is a WebAssembly module.
    """

    sha256: str
    url: str


class WebAssembly(msgspec.Struct):
    """The plan of a frame in the rows layout, and the WebAssembly module with its kernels."""

    plan: ContentReference
    module: ContentReference


class Configuration(msgspec.Struct):
    """A point: its name, parameters, and predictions by the reference device (seconds per frame, metres).

    `backends`: those whose limits it keeps. `plan`: the plan of a frame for WebGPU; `shaders`: its kernels.
    `wasm`: the same for WebAssembly, absent if its buffers take 256 MiB or more.
    `band`: the allowed distance (m) of positions from the reference `trajectory`. `reference_ate`: the errors
    (m) of that trajectory; those of a run differ from them by at most twice its deviation. `skipped`: the
    share of the counted frames that the reference left out; absent for a configuration that computes every
    frame.
    Only in the detail of a front: `learned_on` and `held_out`, [{sequence, ate_max (m), lost (frames)}], the
    worst results on sequences that the search used, and on sequences that it never saw.
    """

    name: str
    parameters: dict[str, Any]
    predicted: dict[str, Any]
    backends: list[str] | UnsetType = UNSET
    plan: ContentReference | UnsetType = UNSET
    shaders: ContentReference | UnsetType = UNSET
    wasm: WebAssembly | UnsetType = UNSET
    band: float | UnsetType = UNSET
    trajectory: ContentReference | UnsetType = UNSET
    reference_ate: Errors | UnsetType = UNSET
    skipped: float | UnsetType = UNSET
    learned_on: list[dict[str, Any]] | UnsetType = UNSET
    held_out: list[dict[str, Any]] | UnsetType = UNSET


class Chunk(msgspec.Struct):
    """A part of the sequence. `url` is relative to the server; its content never changes."""

    sha256: str
    bytes: int
    url: str


class Colour(msgspec.Struct):
    """The pack with the colour frames of a sequence."""

    name: str
    sha256: str
    chunks: list[Chunk]


class Sequence(msgspec.Struct):
    """The pack to download: depth frames, camera, ground truth. `colour` is null if no colour is needed."""

    name: str
    sha256: str
    width: int
    height: int
    frames: int
    volume_size: float | None
    initial_position: list[float] | None
    chunks: list[Chunk]
    colour: Colour | None


class Assignment(msgspec.Struct):
    """A configuration that this device is asked to measure, and the reason."""

    name: str
    why: str


class Manifest(msgspec.Struct):
    """What a client is asked to measure now.

    If `accepting` is false, measurements are not accepted now; `message` gives the reason, or is null.
    If an installation asks for additional work: `assigned`, and `assigned_message` with the reason if it is
    empty. `configurations` and `protocol` are then those of the additional session.
    """

    application: str
    front_version: str
    configurations: list[Configuration]
    protocol: dict[str, Any]
    sequence: Sequence
    consent_version: int
    minimum_app_version: str
    accepting: bool
    message: str | None
    assigned: list[Assignment] | UnsetType = UNSET
    assigned_message: str | UnsetType | None = UNSET


class FrontSummary(msgspec.Struct):
    """A row in the list of fronts."""

    version: str
    application: str
    state: str
    digest: str
    published_at: datetime
    configurations: int


class FrontDetail(msgspec.Struct):
    """A front with all its members.

    `probes` are further configurations, which clients measure only if they are asked to.
    """

    version: str
    application: str
    state: str
    digest: str
    published_at: datetime
    configurations: list[Configuration]
    probes: list[Configuration]
    protocol: dict[str, Any]
    sequence: dict[str, Any]
    provenance: dict[str, Any]


class FrontPage(msgspec.Struct):
    """Fronts, newest first."""

    results: list[FrontSummary]
    next: str | None


def manifest(front: Front, policy: Policy) -> Manifest:
    """`front` as clients see it under `policy`. Clients are at least of the program that prepared it."""
    policy = policy.at_least(front.provenance.get("prepared", {}).get("app_version", "0"))
    return Manifest(
        application=front.application,
        front_version=front.slug,
        configurations=configurations(front),
        protocol=msgspec.to_builtins(front.protocol),
        sequence=sequence(front.sequence),
        consent_version=policy.consent_version,
        minimum_app_version=policy.minimum_app_version,
        accepting=policy.accepting,
        message=policy.message or None,
    )


def assigned_manifest(
    front: Front, policy: Policy, asked: Several[tuple[Point, str]], repeats: int, message: str | None
) -> Manifest:
    """The manifest of an additional session for one client.

    It names the default and the points `asked`, each with its reason, `repeats` times each. Without points it
    is the usual manifest.
    """
    answer = manifest(front, policy)
    answer.assigned = [Assignment(point.name, why) for point, why in asked]
    answer.assigned_message = message
    if asked:
        default = [one for one in answer.configurations if one.name == DEFAULT]
        answer.configurations = default + [_configuration(front, point) for point, _ in asked]
        order = [one.name for one in answer.configurations]
        answer.protocol = answer.protocol | {"order": order, "repeats": repeats}
    return answer


def sequence(pack: Mapping[str, Any]) -> Sequence:
    """The sequence that `pack`, the content of a pack.json, describes."""
    colour = pack.get("colour")
    return Sequence(
        name=pack["name"],
        sha256=pack["sha256"],
        width=pack["width"],
        height=pack["height"],
        frames=pack["frames"],
        volume_size=pack.get("volume_size"),
        initial_position=pack.get("initial_position"),
        chunks=_chunks(pack),
        colour=None if colour is None else Colour(colour["name"], colour["sha256"], _chunks(colour)),
    )


def _chunks(pack: Mapping[str, Any]) -> list[Chunk]:
    return [
        Chunk(chunk["sha256"], chunk["bytes"], f"/sequences/{chunk['sha256']}") for chunk in pack["chunks"]
    ]


def configurations(front: Front) -> list[Configuration]:
    """The points of `front` in published order."""
    return [_configuration(front, point) for point in front.points]


def _configuration(front: Front, point: Point) -> Configuration:
    configuration = Configuration(point.name, point.parameters, msgspec.to_builtins(point.predicted))
    if front.application in SYSTEMS and not plans.has_plans(front.application):
        configuration.backends = list(SYSTEMS[front.application].backends)
    elif (plan := plans.of_point(front, point)) is not None:
        configuration.backends = list(plan.backends)
        configuration.plan = _reference("plans", plan.plan.sha256)
        configuration.shaders = _reference("shaders", plan.shaders.sha256)
        if "wasm" in plan.backends:
            configuration.wasm = WebAssembly(
                _reference("plans", plan.rows.sha256), _reference("modules", plans.module().sha256)
            )
    if point.band is not None and point.trajectory_sha256 is not None:
        configuration.band = point.band
        configuration.trajectory = _reference("trajectories", point.trajectory_sha256)
    if point.reference_ate is not None:
        configuration.reference_ate = point.reference_ate
    if point.skipped is not None:
        configuration.skipped = point.skipped
    return configuration


def _with_results(front: Front, point: Point) -> Configuration:
    configuration = _configuration(front, point)
    if point.learned_on:
        configuration.learned_on = msgspec.to_builtins(list(point.learned_on))
    if point.held_out:
        configuration.held_out = msgspec.to_builtins(list(point.held_out))
    return configuration


def _reference(kind: str, sha256: str) -> ContentReference:
    return ContentReference(sha256, f"/{kind}/{sha256}")


def summary(front: Front) -> FrontSummary:
    """`front` as a row of a list."""
    assert front.published_at is not None  # only published fronts are shown
    return FrontSummary(
        front.slug, front.application, front.state, front.digest, front.published_at, len(front.points)
    )


def detail(front: Front) -> FrontDetail:
    """`front` with all its members."""
    assert front.published_at is not None  # only published fronts are shown
    return FrontDetail(
        version=front.slug,
        application=front.application,
        state=front.state,
        digest=front.digest,
        published_at=front.published_at,
        configurations=[_with_results(front, point) for point in front.points],
        probes=[_with_results(front, point) for point in front.probes],
        protocol=msgspec.to_builtins(front.protocol),
        sequence=front.sequence,
        provenance=front.provenance,
    )
