"""Whether the depths of a sequence can be those of a room, or are read in a wrong unit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slam.datasets.formats.units import MILLIMETRES
from slam.datasets.sequence import Sequence

NEAREST, FURTHEST = 0.3, 10.0  # metres, of the median depth
NEAREST_ASSUMED = 0.6  # millimetres that are read as 5000 units per metre put a wall 2 m away at 0.4 m


def sample_depth(sequence: Sequence) -> npt.NDArray[np.uint16]:
    """Depth (k, height, width) of the first, the middle and the last frame."""
    frames = sorted({0, len(sequence) // 2, len(sequence) - 1})
    return np.stack([sequence.depth(index) for index in frames])


def depth_warning(sequence: Sequence) -> str | None:
    """A sentence if the median of the measured depth is implausible, otherwise None.

    Raises SequenceError for a damaged frame.
    """
    depth = sample_depth(sequence)
    assumed = sequence.assumed_units
    if not depth.any():
        return f"{sequence.name}: no depth is measured in the first, the middle and the last frame"
    median = float(np.median(depth[depth > 0])) / 1000
    nearest = NEAREST_ASSUMED if assumed is not None and assumed > MILLIMETRES else NEAREST
    if nearest <= median <= FURTHEST:
        return None
    text = f"{sequence.name}: the median depth is {median:.2f} m, which is implausible"
    if assumed is not None:
        text += f"; {assumed:g} units per metre were assumed"
    return f"{text}: give --units, the depth units per metre (millimetres are 1000, TUM writes 5000)"
