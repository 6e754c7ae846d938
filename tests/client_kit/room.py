"""A small sequence pack that every configuration below really runs over, in a fraction of a second."""

from pathlib import Path
from typing import Any

from slam.datasets.formats import pack
from tests.client_kit import documents
from tests.slam.kfusion.test_pipeline import CAMERA, SCENE, depth_from, handheld
from tests.slam.sequences import ArraySequence

FRAMES = 12

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


def manifest(room: pack.Pack, **changes: Any) -> dict[str, Any]:
    """A manifest that asks for default and best over the room."""
    sequence = room.manifest
    for chunk in sequence["chunks"]:
        chunk["url"] = f"/sequences/{chunk['sha256']}"
    configurations = [
        {"name": name, "parameters": dict(parameters), "predicted": documents.point(0.1, 0.01)}
        for name, parameters in CONFIGURATIONS.items()
    ]
    return documents.manifest(sequence=sequence, configurations=configurations, **changes)
