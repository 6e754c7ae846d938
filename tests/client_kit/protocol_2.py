"""Protocol 2 over the small room: bands, and reference trajectories as a server publishes them."""

import json
from typing import Any

import numpy as np

from slam.datasets.formats.pack import Pack
from tests.client_kit import documents, room
from tests.slam.kfusion.test_pipeline import SCENE, handheld

BAND = 0.02
PROTOCOL = {
    name: value for name, value in documents.manifest()["protocol"].items() if name != "max_repeats"
} | {"version": 2, "repeats": 4}


def positions(shift: float = 0.0) -> list[list[float]]:
    """Where the room's camera really is after each frame, SHIFT metres aside, in the volume's frame."""
    start = np.array(SCENE.initial_position) * SCENE.volume_size
    found: list[list[float]] = (start + handheld(room.FRAMES)[:, :3, 3] + [shift, 0.0, 0.0]).tolist()
    return found


def manifest(
    pack: Pack, far: tuple[str, ...] = (), **protocol: Any
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """A manifest of protocol 2, and its trajectories by digest; those of FAR are 10 cm aside."""
    document = room.manifest(pack, protocol=PROTOCOL | protocol)
    files = {}
    for configuration in document["configurations"]:
        data = json.dumps(positions(0.1 if configuration["name"] in far else 0.0)).encode()
        digest = documents.digest(data)
        files[digest] = data
        configuration["band"] = BAND
        configuration["trajectory"] = {"sha256": digest, "url": f"/trajectories/{digest}"}
    return document, files
