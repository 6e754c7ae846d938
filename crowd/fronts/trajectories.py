"""Reference trajectories, stored once under their digests."""

import hashlib
from collections.abc import Iterable

import msgspec
from msgspec.structs import replace

from crowd.fronts.models import FrontVersion, Trajectory
from wire.front import Point, Positions


def named(point: Point) -> Point:
    """`point` with the digest of its trajectory instead of the positions."""
    if point.trajectory is None:
        return point
    return replace(point, trajectory=None, trajectory_sha256=digest(encode(point.trajectory)))


def encode(positions: Positions) -> str:
    """`positions` as JSON, as they are stored and served."""
    return msgspec.json.encode(positions).decode()


def digest(content: str) -> str:
    """The digest of a trajectory in JSON."""
    return hashlib.sha256(content.encode()).hexdigest()


def store(positions: Positions) -> Trajectory:
    """The row for `positions`, created if missing."""
    content = encode(positions)
    return Trajectory.objects.get_or_create(sha256=digest(content), defaults={"positions": content})[0]


def read(sha256s: Iterable[str]) -> dict[str, Positions]:
    """The trajectories with these digests. One query."""
    rows = Trajectory.objects.in_bulk(list(sha256s)).values()
    return {row.sha256: msgspec.json.decode(row.positions, type=Positions) for row in rows}


def find_released(sha256: str) -> str | None:
    """The JSON of the trajectory with the digest SHA256, of any released front, or None."""
    fronts = FrontVersion.objects.released()
    row = Trajectory.objects.filter(sha256=sha256, configurations__front__in=fronts).first()
    return None if row is None else row.positions


def delete_unused() -> None:
    """Delete trajectories without a configuration, after a draft was replaced or discarded."""
    Trajectory.objects.filter(configurations=None).delete()
