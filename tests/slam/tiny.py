"""A sequence so small that a measurement of it takes a moment."""

from pathlib import Path

import numpy as np

from slam.datasets import open_sequence, pack
from tests.slam.sequences import ArraySequence
from tests.slam.shipped import LIVING_ROOM


def write_tiny_pack(folder: Path) -> Path:
    """The first 12 frames of the shipped sequence, a quarter as wide and as high, as the pack FOLDER/tiny."""
    whole = open_sequence(LIVING_ROOM)
    depth = np.stack([whole.depth(frame)[::4, ::4] for frame in range(12)])
    assert whole.truth is not None
    tiny = ArraySequence(
        depth,
        truth=whole.truth[:12],
        name="tiny",
        volume_size=whole.volume_size,
        initial_position=whole.initial_position,
    )
    tiny.camera = whole.camera.scaled(4)
    pack.write(tiny, folder / "tiny")
    return folder / "tiny"
