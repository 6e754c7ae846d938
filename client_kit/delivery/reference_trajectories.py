"""Reference trajectories: the position after each frame, and a run's deviation from it."""

import json
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from client_kit.delivery import downloads
from client_kit.delivery.manifest import Configuration, Manifest
from client_kit.delivery.server import NotFrontrunnerError, Server
from client_kit.home import Home, write_file
from wire.manifest import ContentReference

# [x, y, z] of each frame, metres in the volume's frame.
Positions = Sequence[Sequence[float]]


def all_present(manifest: Manifest, home: Home) -> bool:
    """Whether all of the manifest's trajectories were fetched before."""
    return not _missing(manifest, home)


def fetch(
    server: Server, manifest: Manifest, home: Home, pause: Callable[[float], None] = time.sleep
) -> None:
    """Fetch the missing ones of the whole front: another configuration may be measured offline later.

    Raises HomeError (a full disk), and what `downloads.fetch` raises.
    """
    for reference in _missing(manifest, home):
        data = downloads.fetch(server, reference.url, reference.sha256, pause=pause)
        write_file(home.trajectory(reference.sha256), data)


def read(manifest: Manifest, home: Home) -> dict[str, Positions]:
    """The reference trajectories of a front by configuration; all files must be present.

    Raises NotFrontrunnerError for a file that is not a trajectory of the protocol's frames.
    """
    return {
        configuration.name: _positions(
            home.trajectory(configuration.trajectory.sha256), configuration, manifest
        )
        for configuration in manifest.configurations
    }


def deviation(positions: Positions, reference: Positions) -> float:
    """The largest distance (m) between the positions of the same frame; NaN where one is not finite.

    Both are in the volume's frame: nothing is aligned. Raises ValueError for different numbers of frames.
    """
    distances = [math.dist(here, there) for here, there in zip(positions, reference, strict=True)]
    return max(distances) if all(map(math.isfinite, distances)) else math.nan


def _missing(manifest: Manifest, home: Home) -> list[ContentReference]:
    wanted = {one.trajectory.sha256: one.trajectory for one in manifest.configurations}
    return [
        reference
        for sha256, reference in wanted.items()
        if not downloads.matches_digest(home.trajectory(sha256), sha256)
    ]


def _positions(path: Path, configuration: Configuration, manifest: Manifest) -> Positions:
    frames = manifest.protocol.frames
    try:
        positions = [tuple(float(value) for value in position) for position in json.loads(path.read_bytes())]
        if len(positions) != frames or any(len(position) != 3 for position in positions):
            raise ValueError(f"{len(positions)} entries")
        if not all(math.isfinite(value) for position in positions for value in position):
            raise ValueError("a position is not finite")
    except (OSError, TypeError, ValueError) as error:
        raise NotFrontrunnerError(
            f"the reference trajectory of {configuration.name} is not a list of {frames} positions: {error}"
        ) from error
    return positions
