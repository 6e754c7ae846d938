"""The units of depth images."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import SequenceError

LEAST_UNITS, MOST_UNITS = 1.0, 1e6  # a metre; beyond, 16 bits hold no depth of a room
MILLIMETRES = 1000.0  # units a metre
METRES = 1.0  # the unit of images of floating-point numbers
NOT_MEASURED = 65535  # some recordings, such as 7-Scenes, write it where others write 0


def check_units(units: float, source: object) -> float:
    """`units` a metre. Raises SequenceError, which names `source`, where no camera writes such depth."""
    if not LEAST_UNITS <= units <= MOST_UNITS:
        raise SequenceError(
            f"{source}: {units:g} depth units a metre: must be above 0, from {LEAST_UNITS:g} to "
            f"{MOST_UNITS:g}; TUM writes 5000, millimetres are 1000"
        )
    return units


def to_millimetres(image: npt.NDArray[Any], units: float) -> npt.NDArray[np.uint16]:
    """Depth in millimetres of an `image` of uint16 or of floating-point numbers with `units` a metre.

    NaN and depth that does not fit become 0.
    """
    if image.dtype == np.uint16:
        image = np.where(image == NOT_MEASURED, 0, image)
        if units == MILLIMETRES:
            return image.astype(np.uint16, copy=False)
    with np.errstate(over="ignore", invalid="ignore"):
        millimetres = np.rint(image * (MILLIMETRES / units))
    measured = (millimetres >= 0) & (millimetres <= np.iinfo(np.uint16).max)  # also false for NaN
    return np.where(measured, millimetres, 0).astype(np.uint16)
