"""Reference trajectories, stored once under their digests."""

import hashlib
from collections.abc import Iterable

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from crowd.fronts.models import FrontVersion, Trajectory
from slam.trajectories.trajectory import absolute_trajectory_error
from wire.front import Errors, Point, Positions

DECIMALS = 6  # of an error in metres, as of a position


def named(point: Point, truth: NDArray[np.float64] | None = None) -> Point:
    """`point` with the digest of its trajectory instead of the positions, and with its errors.

    `truth`: the true poses (frames, 4, 4), camera to world, if they are known.
    """
    if point.trajectory is None:
        return point
    named = digest(encode(point.trajectory))
    return replace(
        point, trajectory=None, trajectory_sha256=named, reference_ate=errors(point.trajectory, truth)
    )


def errors(positions: Positions, truth: NDArray[np.float64] | None) -> Errors | None:
    """The errors of `positions` of a camera that starts without rotation in the volume's frame.

    None if the first pose of `truth` (frames, 4, 4) is not known: nothing else tells the later rotations.
    """
    if truth is None or not np.isfinite(truth[0]).all():
        return None
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    ate = absolute_trajectory_error(poses, truth)
    return Errors(*(round(value, DECIMALS) for value in (ate.max, ate.mean, ate.rmse)))


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
