"""The map as a cloud of coloured discs in a PLY file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FLOATS = ("x", "y", "z", "nx", "ny", "nz")
_CHANNELS = ("red", "green", "blue")
_OWN = ("radius", "confidence")
VERTEX = np.dtype(
    [(name, "<f4") for name in _FLOATS]
    + [(name, "u1") for name in _CHANNELS]
    + [(name, "<f4") for name in _OWN]
)


def write(path: Path, surfels: NDArray[Any], least_confidence: float = 0.0) -> int:
    """Write the SURFELs with `least_confidence` or more, and return their number.

    A binary little-endian PLY file: one vertex a surfel, in the array's order, with its normal, colour,
    radius (metres) and confidence.
    """
    surfels = surfels[surfels["confidence"] >= least_confidence]
    vertices = np.zeros(len(surfels), VERTEX)
    for axis, name in enumerate(_FLOATS[:3]):
        vertices[name] = surfels["position"][:, axis]
        vertices[f"n{name}"] = surfels["normal"][:, axis]
    for shift, name in zip((0, 8, 16), _CHANNELS, strict=True):
        vertices[name] = surfels["colour"] >> shift & 0xFF
    for name in _OWN:
        vertices[name] = surfels[name]
    kinds = {"<f4": "float", "|u1": "uchar"}
    properties = "".join(f"property {kinds[VERTEX[name].str]} {name}\n" for name in VERTEX.names or ())
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment metres, in the frame of the first camera\n"
        f"element vertex {len(vertices)}\n{properties}end_header\n"
    )
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertices.tobytes())
    return len(vertices)
