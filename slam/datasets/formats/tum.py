"""Folders in the layout of the TUM RGB-D benchmark.

`depth/` and optionally `rgb/` hold images; `depth.txt`, `rgb.txt` or `associations.txt` give their stamps,
otherwise the file names are stamps or frame numbers at 30 Hz; stamps in lists that are written without a
point are frame numbers too, as in ICL-NUIM's `associations.txt`, unless they are nanoseconds since 1970;
`groundtruth.txt` holds TUM poses.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.formats import images
from slam.datasets.formats.listing import listed
from slam.datasets.sequence import (
    LARGEST_SIDE,
    Given,
    Progress,
    Sequence,
    SequenceError,
    check_camera,
    file_sha256,
    make_camera,
    mirror_y,
    read_truth,
)
from slam.trajectories.text_files import read_text
from slam.trajectories.trajectory import Trajectory, associate

T = TypeVar("T", bound=np.generic)

LEAST_UNITS, MOST_UNITS = 1.0, 1e6  # a metre; beyond, 16 bits hold no depth of a room
STANDARD_UNITS = 5000.0  # a metre, in the TUM benchmark's own folders, which carry no intrinsics.txt
NOT_MEASURED = 65535  # some recordings, such as 7-Scenes, write it where others write 0


class TumSequence(Sequence):
    """Depth images of any unit, as millimetres; colour images are matched to them by stamp."""

    def __init__(self, folder: Path, camera: Given = None, truth: Path | None = None) -> None:
        self.name = folder.resolve().name
        self._folder = folder
        self._depth, stamps, numbers = listed(folder, "depth")
        if not self._depth:
            raise SequenceError(f"{folder}/depth holds no image: a TUM-layout folder has depth/*.png")
        size = images.png_size(self._depth[0])
        if isinstance(camera, tuple):
            if size is None:
                raise SequenceError(
                    f"{self._depth[0]} is not a PNG with a size in its header: write intrinsics.txt"
                )
            camera = make_camera(camera, size, folder)
        self.camera, self._units = _intrinsics(folder, camera)
        self._check_focal_length(given=camera is not None)
        if size is not None:
            self._check_size((size[1], size[0]), self._depth[0])
        check_camera(self.camera, folder)
        self.timestamps = stamps
        self._colour = self._matched_colour()
        truth = truth or (folder / "groundtruth.txt" if (folder / "groundtruth.txt").exists() else None)
        if truth is not None:
            self.truth = read_truth(truth, self.camera, stamps, numbers)

    def _check_focal_length(self, given: bool) -> None:
        """Refuse an fy below 0 in intrinsics.txt: only ICL-NUIM mirrors y."""
        if self.camera.fy < 0 and not given:
            raise SequenceError(
                f"{self._folder / 'intrinsics.txt'}: the focal length fy={self.camera.fy:g} must be above 0: "
                "write pixels; where y is mirrored, as in ICL-NUIM, give --camera and --truth"
            )

    def _matched_colour(self) -> dict[int, Path]:
        paths, stamps, _ = listed(self._folder, "rgb")
        frames, rows = associate(self.timestamps, stamps, 0.02)
        return {int(frame): paths[row] for frame, row in zip(frames, rows, strict=True)}

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        image = self._checked(images.read_depth, self._depth[index])
        image = np.where(image == NOT_MEASURED, 0, image)
        if self._units == 1000:
            return image
        millimetres = np.rint(image * (1000 / self._units))
        return np.where(millimetres > 65535, 0, millimetres).astype(np.uint16)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        if index not in self._colour:
            return None
        return self._checked(images.read_colour, self._colour[index])

    def _checked(self, read: Callable[[Path], npt.NDArray[T]], path: Path) -> npt.NDArray[T]:
        """The image at PATH; its size is compared before a file that claims a huge one is decoded."""
        size = images.png_size(path)
        if size is not None:
            self._check_size((size[1], size[0]), path)
        image = read(path)
        self._check_size(image.shape[:2], path)
        return image

    def _check_size(self, shape: tuple[int, ...], path: Path) -> None:
        if shape != (self.camera.height, self.camera.width):
            raise SequenceError(
                f"{path} is {shape[1]}x{shape[0]}, the camera says {self.camera.width}x{self.camera.height}: "
                "correct intrinsics.txt"
            )

    @cached_property
    def sha256(self) -> str:
        """Over the camera, the depth unit and the depth files in order, as they lie on disk."""
        digest = hashlib.sha256(f"{self.camera} {self._units}\n".encode())
        for path in self._depth:
            digest.update(bytes.fromhex(file_sha256(path)))
        return digest.hexdigest()


def write(sequence: Sequence, folder: Path, progress: Progress | None = None) -> None:
    """Write any sequence as a TUM-layout folder, depth in units of a millimetre.

    Where y is mirrored (fy below 0), camera and truth are mirrored back, as such a folder has OpenCV's axes.
    Files of the same names are overwritten.
    """
    frames = len(sequence)
    for kind in ("depth", "rgb"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    listing: dict[str, list[str]] = {"depth": [], "rgb": []}
    for index in range(frames):
        images.write_depth(folder / "depth" / f"{index:06d}.png", sequence.depth(index))
        listing["depth"].append(f"{sequence.timestamps[index]:.6f} depth/{index:06d}.png")
        colour = sequence.colour(index)
        if colour is not None:
            images.write_colour(folder / "rgb" / f"{index:06d}.png", colour)
            listing["rgb"].append(f"{sequence.timestamps[index]:.6f} rgb/{index:06d}.png")
        if progress:
            progress(index + 1, frames)
    for kind, lines in listing.items():
        if lines:
            (folder / f"{kind}.txt").write_text("".join(line + "\n" for line in lines), encoding="utf-8")
        else:
            (folder / kind).rmdir()
    c = sequence.camera
    (folder / "intrinsics.txt").write_text(
        f"{c.fx!r} {abs(c.fy)!r} {c.cx!r} {c.cy!r} {c.width} {c.height} 1000\n", encoding="utf-8"
    )
    if sequence.truth is not None:
        truth = mirror_y(sequence.truth) if c.fy < 0 else sequence.truth
        Trajectory(sequence.timestamps, truth).write(folder / "groundtruth.txt")


def _intrinsics(folder: Path, camera: Camera | None) -> tuple[Camera, float]:
    path = folder / "intrinsics.txt"
    if not path.exists():
        if camera is None:
            raise SequenceError(
                f"{path} is missing: write fx fy cx cy width height depth_units_per_metre, or give the camera"
            )
        return camera, STANDARD_UNITS
    text = read_text(path, SequenceError).split()
    try:
        fx, fy, cx, cy, width, height, units = (float(item) for item in text)
        for name, side in (("width", width), ("height", height)):
            if not (side.is_integer() and 1 <= side <= LARGEST_SIDE):
                raise ValueError(f"{name} {side:g} is not a whole number of pixels from 1 to {LARGEST_SIDE}")
        read = Camera(fx, fy, cx, cy, int(width), int(height))
    except ValueError as error:
        raise SequenceError(
            f"{path}: {' '.join(text)[:80]!r} ({error}): "
            "write seven numbers, fx fy cx cy width height depth_units_per_metre"
        ) from None
    if not LEAST_UNITS <= units <= MOST_UNITS:
        raise SequenceError(
            f"{path}: {units:g} depth units a metre: must be above 0, from {LEAST_UNITS:g} to "
            f"{MOST_UNITS:g}; TUM writes 5000, millimetres are 1000"
        )
    return camera or read, units
