"""Structs of the API's answers about fronts."""

from collections.abc import Mapping
from collections.abc import Sequence as Several
from datetime import datetime
from typing import Any

import msgspec
from msgspec import UNSET
from msgspec.structs import replace

from crowd.fronts.content import plans
from crowd.fronts.intake_policy import Policy
from slam.definitions import SYSTEMS
from wire.front import DEFAULT, Front, Point, Protocol
from wire.manifest import (
    Assignment,
    Chunk,
    Colour,
    Configuration,
    ContentReference,
    Manifest,
    Sequence,
    WebAssembly,
)


class PublishedFront(msgspec.Struct):
    """What identifies a front."""

    version: str
    application: str
    state: str
    digest: str
    published_at: datetime


class FrontSummary(PublishedFront):
    """A row in the list of fronts."""

    configurations: int


class FrontDetail(PublishedFront):
    """A front with all its members.

    `probes` are further configurations, which clients measure only if they are asked to.
    """

    configurations: list[Configuration]
    probes: list[Configuration]
    protocol: Protocol
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
        configurations=tuple(_configuration(front, point) for point in front.points),
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
    """The manifest of an additional session for one client.

    It names the default and the points `asked`, each with its reason, `repeats` times each. Without points it
    is the usual manifest.
    """
    usual = manifest(front, policy)
    answer = replace(
        usual, assigned=tuple(Assignment(point.name, why) for point, why in asked), assigned_message=message
    )
    if not asked:
        return answer
    default = tuple(one for one in usual.configurations if one.name == DEFAULT)
    measured = default + tuple(_configuration(front, point) for point, _ in asked)
    protocol = replace(front.protocol, order=tuple(one.name for one in measured), repeats=repeats)
    return replace(answer, configurations=measured, protocol=protocol)


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


def _chunks(pack: Mapping[str, Any]) -> tuple[Chunk, ...]:
    return tuple(
        Chunk(chunk["sha256"], chunk["bytes"], f"/sequences/{chunk['sha256']}") for chunk in pack["chunks"]
    )


def _configuration(front: Front, point: Point) -> Configuration:
    reference: dict[str, Any] = {}
    if point.band is not None and point.trajectory_sha256 is not None:
        trajectory = _reference("trajectories", point.trajectory_sha256)
        reference = {"band": point.band, "trajectory": trajectory}
    if point.reference_ate is not None:
        reference["reference_ate"] = point.reference_ate
    return Configuration(
        name=point.name,
        parameters=point.parameters,
        predicted=point.predicted,
        **_programs(front, point),
        **reference,
        skipped=UNSET if point.skipped is None else point.skipped,
    )


def _programs(front: Front, point: Point) -> dict[str, Any]:
    """The members of a configuration that say what computes `point`."""
    if front.application in SYSTEMS and not plans.has_plans(front.application):
        return {"backends": SYSTEMS[front.application].backends}
    if (plan := plans.of_point(front, point)) is None:
        return {}
    programs = {
        "backends": plan.backends,
        "plan": _reference("plans", plan.plan.sha256),
        "shaders": _reference("shaders", plan.shaders.sha256),
    }
    if "wasm" not in plan.backends:
        return programs
    rows, module = _reference("plans", plan.rows.sha256), _reference("modules", plans.module().sha256)
    return programs | {"wasm": WebAssembly(rows, module)}


def _with_results(front: Front, point: Point) -> Configuration:
    return replace(
        _configuration(front, point), learned_on=point.learned_on or UNSET, held_out=point.held_out or UNSET
    )


def _reference(kind: str, sha256: str) -> ContentReference:
    return ContentReference(sha256, f"/{kind}/{sha256}")


def summary(front: Front) -> FrontSummary:
    """`front` as a row of a list."""
    return FrontSummary(*_identity(front), len(front.points))


def detail(front: Front) -> FrontDetail:
    """`front` with all its members."""
    return FrontDetail(
        *_identity(front),
        configurations=[_with_results(front, point) for point in front.points],
        probes=[_with_results(front, point) for point in front.probes],
        protocol=front.protocol,
        sequence=front.sequence,
        provenance=front.provenance,
    )


def _identity(front: Front) -> tuple[str, str, str, str, datetime]:
    """The members of `front` for PublishedFront."""
    assert front.published_at is not None  # only published fronts are shown
    return front.slug, front.application, front.state, front.digest, front.published_at
