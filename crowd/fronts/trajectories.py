"""Reference trajectories of protocol 2: stored once under their digest, like the chunks of a sequence."""

import hashlib
from collections.abc import Iterable

import msgspec

from crowd.fronts.models import FrontVersion, Trajectory

# [x, y, z] of each frame, in metres in the volume's frame
Positions = list[list[float]]


def floats(positions: Iterable[Iterable[float]]) -> Positions:
    """POSITIONS with floats alone, so that equal trajectories have one digest."""
    return [[float(value) for value in position] for position in positions]


def encoded(positions: Iterable[Iterable[float]]) -> str:
    """POSITIONS as they are stored and served, in JSON."""
    return msgspec.json.encode(floats(positions)).decode()


def digest(content: str) -> str:
    """The name of the trajectory whose JSON is CONTENT."""
    return hashlib.sha256(content.encode()).hexdigest()


def store(positions: Iterable[Iterable[float]]) -> Trajectory:
    """The row that holds POSITIONS, made where there is none."""
    content = encoded(positions)
    return Trajectory.objects.get_or_create(sha256=digest(content), defaults={"positions": content})[0]


def read(sha256s: Iterable[str]) -> dict[str, Positions]:
    """The trajectories with these digests. One query."""
    rows = Trajectory.objects.in_bulk(list(sha256s)).values()
    return {row.sha256: msgspec.json.decode(row.positions, type=Positions) for row in rows}


def released(sha256: str) -> str | None:
    """The JSON of a trajectory of a front that was ever published; None where none has this digest."""
    fronts = FrontVersion.objects.released()
    row = Trajectory.objects.filter(sha256=sha256, configurations__front__in=fronts).first()
    return None if row is None else row.positions


def delete_unused() -> None:
    """Delete what no configuration refers to any more, once a draft is replaced or discarded."""
    Trajectory.objects.filter(configurations=None).delete()
