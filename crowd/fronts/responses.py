"""Shapes of the answers about fronts."""

from collections.abc import Mapping
from collections.abc import Sequence as Several
from datetime import datetime
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from crowd.fronts.content import plans
from crowd.fronts.content.front_file import APPLICATIONS
from crowd.fronts.policy import Policy
from crowd.fronts.selectors import DEFAULT, Front, Point


class Addressed(msgspec.Struct):
    """JSON that never changes, at `url` relative to the server.

    A plan (slam/plans/schema.json), shaders: an object with the WGSL text of each kernel by its name, or a
    trajectory: a list of [x, y, z] in metres, one a frame.
    """

    sha256: str
    url: str


class Configuration(msgspec.Struct):
    """One point: its name, its parameters, what the reference device predicts (seconds a frame, metres).

    `backends`: those whose default limits it keeps. Where a frame is planned, `plan`: what happens in it, and
    `shaders`: the kernels that the plan launches.
    Protocol 2 alone: `band`, how far (m) positions may be from the reference `trajectory`.
    A front in full alone: `learned_on` and `held_out`, [{sequence, ate_max (m), lost (frames)}], the worst
    results on the sequences that the search minimised errors on, and on those that it never saw.
    """

    name: str
    parameters: dict[str, Any]
    predicted: dict[str, Any]
    backends: list[str] | UnsetType = UNSET
    plan: Addressed | UnsetType = UNSET
    shaders: Addressed | UnsetType = UNSET
    band: float | UnsetType = UNSET
    trajectory: Addressed | UnsetType = UNSET
    learned_on: list[dict[str, Any]] | UnsetType = UNSET
    held_out: list[dict[str, Any]] | UnsetType = UNSET


class Chunk(msgspec.Struct):
    """A part of the sequence; `url` is relative to the server and never changes its content."""

    sha256: str
    bytes: int
    url: str


class Colour(msgspec.Struct):
    """The pack of colour frames that belongs to a sequence."""

    name: str
    sha256: str
    chunks: list[Chunk]


class Sequence(msgspec.Struct):
    """The pack to download: depth frames, camera, truth; `colour` is null where no colour is needed."""

    name: str
    sha256: str
    width: int
    height: int
    frames: int
    volume_size: float | None
    initial_position: list[float] | None
    chunks: list[Chunk]
    colour: Colour | None


class Asked(msgspec.Struct):
    """A configuration that this device in particular is asked to measure, and why."""

    name: str
    why: str


class Manifest(msgspec.Struct):
    """What a client is asked to measure now.

    Where `accepting` is false nothing is taken now; `message` says why, null where nobody did.
    Only where an installation asks what it shall measure besides: `assigned`, and `assigned_message` where
    that is empty for a reason. Then `configurations` and `protocol` are those of that session.
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
    assigned: list[Asked] | UnsetType = UNSET
    assigned_message: str | UnsetType | None = UNSET


class FrontSummary(msgspec.Struct):
    """One line in the list of fronts."""

    version: str
    application: str
    state: str
    digest: str
    published_at: datetime
    configurations: int


class FrontDetail(msgspec.Struct):
    """A whole front with where it comes from.

    `probes` are further configurations, which clients measure only when they are asked to.
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
    """FRONT as clients see it under POLICY."""
    return Manifest(
        application=front.application,
        front_version=front.slug,
        configurations=configurations(front),
        protocol=front.protocol,
        sequence=sequence(front.sequence),
        consent_version=policy.consent_version,
        minimum_app_version=policy.minimum_app_version,
        accepting=policy.accepting,
        message=policy.message or None,
    )


def assigned_manifest(
    front: Front, policy: Policy, asked: Several[tuple[Point, str]], repeats: int, message: str | None
) -> Manifest:
    """What one client is asked to measure after default and best: the points ASKED, each with its reason, and
    the default, each REPEATS times. Without any it has the front's own configurations and protocol.
    """
    found = manifest(front, policy)
    found.assigned = [Asked(point.name, why) for point, why in asked]
    found.assigned_message = message
    if asked:
        default = [one for one in found.configurations if one.name == DEFAULT]
        found.configurations = default + [_configuration(front, point) for point, _ in asked]
        order = [one.name for one in found.configurations]
        found.protocol = found.protocol | {"order": order, "repeats": repeats}
    return found


def sequence(pack: Mapping[str, Any]) -> Sequence:
    """What a client needs to download the sequence that PACK, a pack.json with any colour, describes."""
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
    """The points of FRONT in published order."""
    return [_configuration(front, point) for point in front.points]


def _configuration(front: Front, point: Point) -> Configuration:
    found = Configuration(point.name, point.parameters, point.predicted)
    if front.application in APPLICATIONS and front.application != plans.KFUSION:
        found.backends = list(APPLICATIONS[front.application].backends)
    elif (plan := plans.of_point(front, point)) is not None:
        found.backends = list(plan.backends)
        found.plan = _addressed("plans", plan.plan.sha256)
        found.shaders = _addressed("shaders", plan.shaders.sha256)
    if point.band is not None and point.trajectory_sha256 is not None:
        found.band = point.band
        found.trajectory = _addressed("trajectories", point.trajectory_sha256)
    return found


def _with_results(front: Front, point: Point) -> Configuration:
    found = _configuration(front, point)
    if point.learned_on:
        found.learned_on = [dict(result) for result in point.learned_on]
    if point.held_out:
        found.held_out = [dict(result) for result in point.held_out]
    return found


def _addressed(kind: str, sha256: str) -> Addressed:
    return Addressed(sha256, f"/{kind}/{sha256}")


def summary(front: Front) -> FrontSummary:
    """FRONT in a list."""
    assert front.published_at is not None  # only what was published is shown
    return FrontSummary(
        front.slug, front.application, front.state, front.digest, front.published_at, len(front.points)
    )


def detail(front: Front) -> FrontDetail:
    """FRONT in full."""
    assert front.published_at is not None  # only what was published is shown
    return FrontDetail(
        version=front.slug,
        application=front.application,
        state=front.state,
        digest=front.digest,
        published_at=front.published_at,
        configurations=[_with_results(front, point) for point in front.points],
        probes=[_with_results(front, point) for point in front.probes],
        protocol=front.protocol,
        sequence=front.sequence,
        provenance=front.provenance,
    )
