"""ICL-NUIM's living room (Handa et al. 2014), in both forms in which it is published.

The *PNG form* is a TUM-like folder: `depth/N.png` with 5000 units a metre along the optical axis, `rgb/N.png`
and `livingRoomK.gt.freiburg`. The *original form* is a folder of `scene_00_NNNN.depth` (text, the length of
every pixel's ray in metres), `.png` (colour) and `.txt` (POV-Ray's camera).

Both lack intrinsics (fx 481.2, fy -480, cx 319.5, cy 239.5 for 640x480) and have y up, hence the negative
fy. Read here, poses and camera have OpenCV's axes: y is mirrored and fy is 480.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.formats import images, tum
from slam.datasets.formats.listing import frame_number
from slam.datasets.formats.units import NOT_MEASURED
from slam.datasets.sequence import (
    FRAME_RATE,
    Given,
    Progress,
    Sequence,
    SequenceError,
    check_camera,
    file_sha256,
    make_camera,
    read_truth,
)
from slam.trajectories.readings import mirror_y
from slam.trajectories.text_files import read_text
from slam.trajectories.trajectory import Trajectory, check_poses

CAMERA = Camera(481.2, 480.0, 319.5, 239.5, 640, 480)
# Volume size (m) and start (fraction of it) that SLAMBench gives for the four trajectories.
SCENES: dict[int, tuple[float, tuple[float, float, float]]] = {
    0: (5.0, (0.34, 0.5, 0.24)),
    1: (5.0, (0.485, 0.5, 0.55)),
    2: (4.8, (0.34, 0.5, 0.24)),
    3: (5.0, (0.2685, 0.5, 0.4)),
}
_POSE_FILE = "*.gt.freiburg"
_FURTHEST = 65535  # millimetres that fit a depth image here
_VECTOR = re.compile(r"^\s*(cam_\w+)\s*=\s*\[([^\]]*)\]", re.MULTILINE)


def is_png_form(folder: Path) -> bool:
    return (folder / "depth").is_dir() and any(folder.glob(_POSE_FILE))


def is_original_form(folder: Path) -> bool:
    return any(folder.glob("scene_*_*.depth"))


class IclNuimSequence(tum.TumSequence):
    """The PNG form. The camera is the dataset's own unless one is given or `intrinsics.txt` is there."""

    truth_axes = "y-up"

    def __init__(
        self, folder: Path, camera: Given = None, truth: Path | None = None, units: float | None = None
    ) -> None:
        poses = min(folder.glob(_POSE_FILE))
        super().__init__(folder, camera, truth or poses, units, usual_camera=CAMERA)
        if self.camera.fy < 0:
            self.camera = _upright(self.camera)
            self.truth = None if self.truth is None else mirror_y(self.truth)
        self.volume_size, self.initial_position = _scene(poses.name)

    def _check_focal_length(self, given: bool) -> None:
        """An fy below 0 is ICL-NUIM's own, and mirrored when the sequence is opened."""


class IclNuimOriginal(Sequence):
    """The original form; depth becomes millimetres along the optical axis when a frame is read."""

    truth_axes = "y-up"

    def __init__(self, folder: Path, camera: Given = None, truth: Path | None = None) -> None:
        self.name = folder.resolve().name
        if isinstance(camera, tuple):
            camera = make_camera(camera, (CAMERA.width, CAMERA.height), folder)
        self.camera = _upright(camera or CAMERA)
        check_camera(self.camera, folder)
        numbered = sorted((_number(path), path) for path in folder.glob("scene_*_*.depth"))
        self._depth = [path for _, path in numbered]
        numbers = np.array([number for number, _ in numbered], dtype=np.int64)
        self.timestamps = numbers / FRAME_RATE
        self.volume_size, self.initial_position = _scene(self.name)
        if truth is not None:
            self.truth = read_truth(truth, self.camera, self.timestamps, numbers)
        elif any(path.with_suffix(".txt").exists() for path in self._depth):
            self.truth = np.array([_pose(path.with_suffix(".txt")) for path in self._depth])
            check_poses(self.truth, folder, "the camera of frame")

    @cached_property
    def _lengths(self) -> npt.NDArray[np.float64]:
        """The length of every pixel's ray to the plane one metre ahead, (height, width)."""
        return ray_lengths(self.camera)

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        path = self._depth[index]
        try:
            distances = np.array(path.read_bytes().split(), dtype=np.float64)
        except (OSError, ValueError) as error:
            raise SequenceError(f"{path} cannot be read as distances in metres: {error}") from None
        if distances.size != self._lengths.size:
            raise SequenceError(
                f"{path} holds {distances.size} distances, an image of {self.camera.width}x"
                f"{self.camera.height} has {self._lengths.size}: it is cut short, or give its camera and size"
            )
        # NaN and depths that are too large count as not measured.
        with np.errstate(over="ignore", invalid="ignore"):
            millimetres = np.rint(1000 * distances.reshape(self._lengths.shape) / self._lengths)
        measured = (millimetres >= 0) & (millimetres <= _FURTHEST)  # also false for NaN
        return np.where(measured, millimetres, 0).astype(np.uint16)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        path = self._depth[index].with_suffix(".png")
        if not path.exists():
            return None
        image = images.read_colour(path)
        if image.shape[:2] != self._lengths.shape:
            raise SequenceError(
                f"{path} is {image.shape[1]}x{image.shape[0]}, the camera says "
                f"{self.camera.width}x{self.camera.height}"
            )
        return image

    @cached_property
    def sha256(self) -> str:
        """Over the camera and the depth files in order, as they lie on disk."""
        digest = hashlib.sha256(f"{self.camera}\n".encode())
        for path in self._depth:
            digest.update(bytes.fromhex(file_sha256(path)))
        return digest.hexdigest()


def ray_lengths(camera: Camera) -> npt.NDArray[np.float64]:
    """sqrt(((u-cx)/fx)^2 + ((v-cy)/fy)^2 + 1) of every pixel, (height, width): ray length over depth."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = (np.arange(camera.height) - camera.cy) / camera.fy
    lengths: npt.NDArray[np.float64] = np.sqrt(x[None, :] ** 2 + y[:, None] ** 2 + 1)
    return lengths


def write(sequence: Sequence, folder: Path, progress: Progress | None = None) -> None:
    """Write any sequence in the PNG form.

    `intrinsics.txt` is added where the camera is not ICL-NUIM's, and without truth, as the pose file is what
    tells the form from TUM's.

    Depth beyond 13.107 m does not fit 5000 units a metre and becomes 0, not measured.
    """
    (folder / "depth").mkdir(parents=True, exist_ok=True)
    lines = []
    for index in range(len(sequence)):
        depth = sequence.depth(index).astype(np.uint32) * 5
        images.write_depth(
            folder / "depth" / f"{index}.png", np.where(depth < NOT_MEASURED, depth, 0).astype(np.uint16)
        )
        line = f"{index} depth/{index}.png"
        colour = sequence.colour(index)
        if colour is not None:
            (folder / "rgb").mkdir(exist_ok=True)
            images.write_colour(folder / "rgb" / f"{index}.png", colour)
            line += f" {index} rgb/{index}.png"
        lines.append(line + "\n")
        if progress:
            progress(index + 1, len(sequence))
    (folder / "associations.txt").write_text("".join(lines), encoding="utf-8")
    camera = _upright(sequence.camera)
    if camera != CAMERA or sequence.truth is None:
        (folder / "intrinsics.txt").write_text(
            f"{camera.fx!r} {camera.fy!r} {camera.cx!r} {camera.cy!r} {camera.width} {camera.height} 5000\n",
            encoding="utf-8",
        )
    if sequence.truth is not None:
        stamps = np.arange(len(sequence), dtype=np.float64)
        Trajectory(stamps, _upward(sequence)).write(folder / f"{folder.name}.gt.freiburg")


def write_original(sequence: Sequence, folder: Path, progress: Progress | None = None) -> None:
    """Write any sequence in the original form; distances keep the millimetres exactly.

    The form has no place for intrinsics: its reader must know `sequence.camera`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lengths = ray_lengths(sequence.camera) / 1000
    poses = None if sequence.truth is None else _upward(sequence)
    for index in range(len(sequence)):
        stem = folder / f"scene_00_{index:04d}"
        distances = sequence.depth(index) * lengths
        stem.with_suffix(".depth").write_text(
            " ".join(map("{:.8g}".format, distances.ravel().tolist())) + "\n", encoding="ascii"
        )
        colour = sequence.colour(index)
        if colour is not None:
            images.write_colour(stem.with_suffix(".png"), colour)
        if poses is not None and np.isfinite(poses[index]).all():
            stem.with_suffix(".txt").write_text(_povray(poses[index]), encoding="ascii")
        if progress:
            progress(index + 1, len(sequence))


def _upright(camera: Camera) -> Camera:
    return Camera(camera.fx, abs(camera.fy), camera.cx, camera.cy, camera.width, camera.height)


def _upward(sequence: Sequence) -> npt.NDArray[np.float64]:
    """The truth with y up. A camera with a negative fy has its poses so already."""
    assert sequence.truth is not None
    return sequence.truth if sequence.camera.fy < 0 else mirror_y(sequence.truth)


def _scene(name: str) -> tuple[float, tuple[float, float, float]] | tuple[None, None]:
    """Volume and start of `livingRoom2.gt.freiburg`, and of folders such as `icl-kt2`."""
    match = re.search(r"(?:livingRoom|living_room_traj|(?<![a-zA-Z])kt)(\d)", name)
    return SCENES.get(int(match[1]), (None, None)) if match else (None, None)


def _number(path: Path) -> int:
    digits = path.stem.rsplit("_", 1)[1]
    if not digits.isdecimal():
        raise SequenceError(f"{path}: name frames scene_00_0000.depth, scene_00_0001.depth, ...")
    return frame_number(digits, path)


def _pose(path: Path) -> npt.NDArray[np.float64]:
    """The pose (4, 4) in OpenCV axes of a POV-Ray camera, NaN where there is no file.

    In POV-Ray's left-handed axes the camera looks along cam_dir with cam_up above it; its right is their
    cross product, as in the dataset's own code. Mirroring y makes the axes right-handed.
    """
    if not path.exists():
        return np.full((4, 4), np.nan)
    try:
        text = read_text(path, SequenceError)
        vectors = {
            name: np.array([float(item) for item in values.replace(",", " ").split()])
            for name, values in _VECTOR.findall(text)
        }
        ahead, up, position = (vectors[name].reshape(3) for name in ("cam_dir", "cam_up", "cam_pos"))
        if not np.isfinite([ahead, up, position]).all():
            raise ValueError("a number is not finite")
    except SequenceError:
        raise
    except (ValueError, KeyError) as error:
        raise SequenceError(
            f"{path} is not a camera of ICL-NUIM ({error}): write cam_pos, cam_dir and cam_up as [x, y, z]'"
        ) from None
    ahead, up = (vector / max(np.abs(vector).max(), 1e-300) for vector in (ahead, up))
    right = np.cross(up, ahead)
    if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(up) * np.linalg.norm(ahead):
        raise SequenceError(f"{path}: cam_dir {ahead} and cam_up {up} do not span a camera")
    z = ahead / np.linalg.norm(ahead)
    x = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.column_stack([x, np.cross(z, x), z, position])
    return mirror_y(pose)


def _povray(pose: npt.NDArray[np.float64]) -> str:
    """The text of a POV-Ray camera with y up."""
    aspect = CAMERA.width / CAMERA.height
    vectors: dict[str, Iterable[float]] = {
        "cam_pos": pose[:3, 3],
        "cam_dir": pose[:3, 2],
        "cam_up": pose[:3, 1],
        "cam_lookat": [0.0, 0.0, 1.0],
        "cam_sky": [0.0, 1.0, 0.0],
        "cam_right": aspect * pose[:3, 0],
        "cam_fpoint": [0.0, 0.0, 10.0],
    }
    lines = [f"{name:12} = [{', '.join(f'{x:.10g}' for x in vector)}]';" for name, vector in vectors.items()]
    return "".join(line + "\n" for line in [*lines, f"{'cam_angle':12} = 90;"])
