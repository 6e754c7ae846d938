"""A small sequence pack that every configuration below really runs over, in a fraction of a second."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from client_kit.delivery.manifest import Manifest
from client_kit.delivery.reference_trajectories import Positions
from slam.datasets.formats import pack
from tests.builders import manifests
from tests.slam.kfusion.test_pipeline import CAMERA, SCENE, depth_from, handheld
from tests.slam.sequences import ArraySequence

FRAMES = 12
BAND = 0.02

CONFIGURATIONS = {
    "default": {"volume_resolution": 128, "integration_rate": 1},
    "best": {"volume_resolution": 64, "compute_size_ratio": 2},
    "indivisible": {"compute_size_ratio": 7},
}


def write(folder: Path, name: str = "room") -> pack.Pack:
    """Write the room as a pack of two chunks of frames and a header."""
    truth = handheld(FRAMES)
    sequence = ArraySequence(
        [depth_from(pose) for pose in truth],
        truth=truth,
        name=name,
        volume_size=SCENE.volume_size,
        initial_position=SCENE.initial_position,
    )
    sequence.camera = CAMERA
    return pack.write(sequence, folder)


def positions(shift: float = 0.0) -> list[list[float]]:
    """Where the room's camera really is after each frame, `shift` metres aside, in the volume's frame."""
    start = np.array(SCENE.initial_position) * SCENE.volume_size
    found: list[list[float]] = (start + handheld(FRAMES)[:, :3, 3] + [shift, 0.0, 0.0]).tolist()
    return found


NEAR, FAR = (json.dumps(positions(shift)).encode() for shift in (0.0, 0.1))
TRAJECTORIES = {manifests.digest(data): data for data in (NEAR, FAR)}


def manifest(room: pack.Pack, far: tuple[str, ...] = (), **changes: Any) -> dict[str, Any]:
    """A manifest that asks for default and best over the room; the references of `far` are 10 cm aside."""
    sequence = room.manifest
    for chunk in sequence["chunks"]:
        chunk["url"] = f"/sequences/{chunk['sha256']}"
    configurations = [
        manifests.configuration(
            name,
            dict(parameters),
            band=BAND,
            trajectory=manifests.reference(FAR if name in far else NEAR),
        )
        for name, parameters in CONFIGURATIONS.items()
    ]
    return manifests.manifest(sequence=sequence, configurations=configurations, **changes)


def references(asked: Manifest) -> dict[str, Positions]:
    """The reference trajectories of a manifest over the room."""
    return {
        name: json.loads(TRAJECTORIES[configuration.reference.sha256])
        for name, configuration in asked.configurations.items()
    }
