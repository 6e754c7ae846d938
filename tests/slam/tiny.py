"""A sequence so small that a measurement of it takes a moment."""

from pathlib import Path

import numpy as np

from slam.datasets import open_sequence
from slam.datasets.formats import pack
from tests.shipped import LIVING_ROOM
from tests.slam.sequences import ArraySequence

FRAMES = 12


def write_tiny_pack(folder: Path, colour: bool = False, name: str = "tiny", step: int = 4) -> Path:
    """The first FRAMES frames of the shipped sequence, each `step`-th pixel, as the pack `folder`/NAME.

    With `colour` that lies beside it, in `folder`/NAME-colour.
    """
    whole = open_sequence(LIVING_ROOM)
    depth = np.stack([whole.depth(frame)[::step, ::step] for frame in range(FRAMES)])
    assert whole.truth is not None
    tiny = ArraySequence(
        depth,
        colour=[np.asarray(whole.colour(frame))[::step, ::step] for frame in range(FRAMES)]
        if colour
        else None,
        truth=whole.truth[:FRAMES],
        name=name,
        volume_size=whole.volume_size,
        initial_position=whole.initial_position,
    )
    tiny.camera = whole.camera.scaled(step)
    written = pack.write(tiny, folder / name)
    if colour:
        pack.write_colour(tiny, written, pack.colour_folder(folder / name))
    return folder / name
