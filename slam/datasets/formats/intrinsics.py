"""The camera of a folder of images: `intrinsics.txt`, or the JSON file of Open3D's recorders.

`intrinsics.txt` holds fx fy cx cy width height depth_units_per_metre. `intrinsic.json` (Open3D's reader of
RealSense bags) and `camera_intrinsic.json` (its recorder) hold width, height, `intrinsic_matrix` by columns,
and sometimes `depth_scale`, the units per metre.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from slam.camera import Camera
from slam.datasets.formats.units import MILLIMETRES, check_units
from slam.datasets.sequence import LARGEST_SIDE, SequenceError
from slam.trajectories.text_files import read_text

TEXT = "intrinsics.txt"
JSON = ("intrinsic.json", "camera_intrinsic.json")


def read_intrinsics(folder: Path) -> tuple[Camera, float] | None:
    """The camera and the depth units per metre; None where the folder has neither file.

    Raises SequenceError for a file that is not as described above.
    """
    if (folder / TEXT).exists():
        return _from_text(folder / TEXT)
    file = next((folder / name for name in JSON if (folder / name).exists()), None)
    return _from_json(file) if file else None


def _from_text(path: Path) -> tuple[Camera, float]:
    text = read_text(path, SequenceError).split()
    try:
        fx, fy, cx, cy, width, height, units = (float(item) for item in text)
        camera = _camera(fx, fy, cx, cy, width, height)
    except ValueError as error:
        raise SequenceError(
            f"{path}: {' '.join(text)[:80]!r} ({error}): "
            "write seven numbers, fx fy cx cy width height depth_units_per_metre"
        ) from None
    return camera, check_units(units, path)


def _from_json(path: Path) -> tuple[Camera, float]:
    try:
        values = json.loads(read_text(path, SequenceError))
        matrix = [float(item) for item in values["intrinsic_matrix"]]
        if len(matrix) != 9:
            raise ValueError(f"intrinsic_matrix has {len(matrix)} numbers")
        fx, fy, cx, cy = (matrix[index] for index in (0, 4, 6, 7))
        camera = _camera(fx, fy, cx, cy, float(values["width"]), float(values["height"]))
        units = float(values.get("depth_scale", MILLIMETRES))
    except SequenceError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise SequenceError(
            f"{path} is not a camera of Open3D ({error}): write width, height and intrinsic_matrix, nine "
            f"numbers by columns, or {TEXT}"
        ) from None
    return camera, check_units(units, path)


def _camera(fx: float, fy: float, cx: float, cy: float, width: float, height: float) -> Camera:
    """Raise ValueError where a side is not a number of pixels or Camera refuses the others."""
    for name, side in (("width", width), ("height", height)):
        if not (math.isfinite(side) and side.is_integer() and 1 <= side <= LARGEST_SIDE):
            raise ValueError(f"{name} {side:g} is not a whole number of pixels from 1 to {LARGEST_SIDE}")
    return Camera(fx, fy, cx, cy, int(width), int(height))
