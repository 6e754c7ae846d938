"""Folders of 7-Scenes (Shotton et al. 2013).

A frame is `frame-000000.depth.png`, `.color.png` and `.pose.txt`. Depth is in millimetres and 65535 where not
measured. A pose file is a matrix of 4x4 numbers, camera to world. The folders hold no intrinsics; the authors
give 585, 585, 320, 240 for both cameras, which are not registered.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.formats.image_folder import ImageFolder
from slam.datasets.formats.listing import frame_number
from slam.datasets.sequence import FRAME_RATE, Given, SequenceError, read_truth
from slam.trajectories.text_files import read_text
from slam.trajectories.trajectory import check_poses

CAMERA = Camera(585.0, 585.0, 320.0, 240.0, 640, 480)
PREFIX, DEPTH, COLOUR, POSE = "frame-", ".depth.png", ".color.png", ".pose.txt"
_FRAMES = f"{PREFIX}*{DEPTH}"


def is_seven_scenes(folder: Path) -> bool:
    return any(folder.glob(_FRAMES))


class SevenScenes(ImageFolder):
    """The frames of one recording, 30 a second; the camera is the usual one unless another is given."""

    def __init__(
        self, folder: Path, camera: Given = None, truth: Path | None = None, units: float | None = None
    ) -> None:
        frames = sorted((_number(path), path) for path in folder.glob(_FRAMES))
        super().__init__(folder, [path for _, path in frames], camera, units, usual_camera=CAMERA)
        numbers = np.array([number for number, _ in frames], dtype=np.int64)
        self.timestamps = numbers / FRAME_RATE
        colour = [_beside(path, COLOUR) for path in self._depth]
        self._colour = {index: path for index, path in enumerate(colour) if path.exists()}
        poses = [_beside(path, POSE) for path in self._depth]
        if truth is not None:
            self.truth = read_truth(truth, self.camera, self.timestamps, numbers)
        elif any(path.exists() for path in poses):
            self.truth = np.array([_pose(path) for path in poses])
            check_poses(self.truth, folder, "the pose of frame")


def _beside(depth: Path, ending: str) -> Path:
    return depth.with_name(depth.name.removesuffix(DEPTH) + ending)


def _number(path: Path) -> int:
    digits = path.name.removeprefix(PREFIX).removesuffix(DEPTH)
    if not digits.isdecimal():
        raise SequenceError(f"{path}: name frames {PREFIX}000000{DEPTH}, {PREFIX}000001{DEPTH}, ...")
    return frame_number(digits, path)


def _pose(path: Path) -> npt.NDArray[np.float64]:
    """The pose (4, 4) in the file; NaN where there is no file, or a number in it is not finite."""
    if not path.exists():
        return np.full((4, 4), np.nan)
    text = read_text(path, SequenceError).split()
    try:
        pose = np.array(text, dtype=np.float64).reshape(4, 4)
    except ValueError:
        raise SequenceError(f"{path} is not a pose of 7-Scenes: write a matrix of 4x4 numbers") from None
    return pose if np.isfinite(pose).all() else np.full((4, 4), np.nan)
