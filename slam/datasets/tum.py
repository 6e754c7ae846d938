"""Folders in the layout of the TUM RGB-D benchmark.

`depth/` and optionally `rgb/` hold images; `depth.txt`, `rgb.txt` or `associations.txt` give their stamps,
otherwise the file names are stamps or frame numbers at 30 Hz; stamps in lists that are written without a
point are frame numbers too, as in ICL-NUIM's `associations.txt`; `groundtruth.txt` holds TUM poses;
`intrinsics.txt` holds fx fy cx cy width height depth_units_per_metre.
"""

from __future__ import annotations

import hashlib
import math
import re
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets import images
from slam.datasets.sequence import (
    FRAME_RATE,
    Given,
    Progress,
    Sequence,
    SequenceError,
    check_camera,
    make_camera,
    read_truth,
)
from slam.trajectory import Trajectory, associate

STANDARD_UNITS = 5000.0  # a metre, in the TUM benchmark's own folders, which carry no intrinsics.txt
NOT_MEASURED = 65535  # some recordings, such as 7-Scenes, write it where others write 0
IMAGES = (".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff")


class TumSequence(Sequence):
    """Depth images of any unit, as millimetres; colour images are matched to them by stamp."""

    def __init__(self, folder: Path, camera: Given = None, truth: Path | None = None) -> None:
        self.name = folder.resolve().name
        self._folder = folder
        self._depth, stamps, numbers = _listed(folder, "depth")
        if not self._depth:
            raise SequenceError(f"{folder}/depth holds no image: a TUM-layout folder has depth/*.png")
        size = images.png_size(self._depth[0])
        if isinstance(camera, tuple):
            if size is None:
                raise SequenceError(f"{self._depth[0]} is no PNG that tells its size: write intrinsics.txt")
            camera = make_camera(camera, size, folder)
        self.camera, self._units = _intrinsics(folder, camera)
        if size is not None:
            self._check_size((size[1], size[0]), self._depth[0])
        check_camera(self.camera, folder)
        self.timestamps = stamps
        self._colour = self._matched_colour()
        truth = truth or (folder / "groundtruth.txt" if (folder / "groundtruth.txt").exists() else None)
        if truth is not None:
            self.truth = read_truth(truth, self.camera, stamps, numbers)

    def _matched_colour(self) -> dict[int, Path]:
        paths, stamps, _ = _listed(self._folder, "rgb")
        frames, rows = associate(self.timestamps, stamps, 0.02)
        return {int(frame): paths[row] for frame, row in zip(frames, rows, strict=True)}

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        image = images.read_depth(self._depth[index])
        self._check_size(image.shape, self._depth[index])
        image = np.where(image == NOT_MEASURED, 0, image)
        if self._units == 1000:
            return image
        millimetres = np.rint(image * (1000 / self._units))
        return np.where(millimetres > 65535, 0, millimetres).astype(np.uint16)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        if index not in self._colour:
            return None
        image = images.read_colour(self._colour[index])
        self._check_size(image.shape[:2], self._colour[index])
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
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def write(sequence: Sequence, folder: Path, progress: Progress | None = None) -> None:
    """Write any sequence as a TUM-layout folder, depth in units of a millimetre.

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
        f"{c.fx!r} {c.fy!r} {c.cx!r} {c.cy!r} {c.width} {c.height} 1000\n", encoding="utf-8"
    )
    if sequence.truth is not None:
        Trajectory(sequence.timestamps, sequence.truth).write(folder / "groundtruth.txt")


def _intrinsics(folder: Path, camera: Camera | None) -> tuple[Camera, float]:
    path = folder / "intrinsics.txt"
    if not path.exists():
        if camera is None:
            raise SequenceError(
                f"{path} is missing: write fx fy cx cy width height depth_units_per_metre, or give the camera"
            )
        return camera, STANDARD_UNITS
    text = path.read_text(encoding="utf-8").split()
    try:
        fx, fy, cx, cy, width, height, units = (float(item) for item in text)
        read = Camera(fx, fy, cx, cy, int(width), int(height))
    except ValueError as error:
        raise SequenceError(
            f"{path}: {' '.join(text)[:80]!r} ({error}): "
            "write seven numbers, fx fy cx cy width height depth_units_per_metre"
        ) from None
    if not units > 0:
        raise SequenceError(f"{path}: {units} depth units a metre: must be above 0, TUM writes 5000")
    return camera or read, units


def _listed(
    folder: Path, kind: str
) -> tuple[list[Path], npt.NDArray[np.float64], npt.NDArray[np.int64] | None]:
    """Images of `kind` in order, their stamps, and their numbers where numbers are all that they have."""
    for listing in (folder / f"{kind}.txt", folder / "associations.txt"):
        if listing.exists():
            entries = _entries(listing, kind)
            if entries:
                entries.sort(key=lambda entry: float(entry[0]))
                return [folder / name for _, name in entries], *_timed([stamp for stamp, _ in entries])
    files = [path for path in (folder / kind).glob("*") if path.suffix.lower() in IMAGES]
    if all(re.fullmatch(r"\D*\d+\D*", path.stem) for path in files):
        numbered = sorted((int(re.sub(r"\D", "", path.stem)), path) for path in files)
        numbers = np.array([number for number, _ in numbered], dtype=np.int64)
        return [path for _, path in numbered], numbers / FRAME_RATE, numbers
    try:
        stamped = sorted((float(path.stem), path) for path in files)
    except ValueError as error:
        raise SequenceError(
            f"{folder / kind}: {error}: name images by number or stamp, or list them in {kind}.txt"
        ) from None
    return [path for _, path in stamped], np.array([stamp for stamp, _ in stamped]), None


def _timed(
    texts: list[str],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64] | None]:
    """Seconds of stamps, and frame numbers where the stamps are those: all written without a point."""
    stamps = np.array([float(text) for text in texts])
    if not all(text.isdecimal() for text in texts):
        return stamps, None
    return stamps / FRAME_RATE, stamps.astype(np.int64)


def _entries(listing: Path, kind: str) -> list[tuple[str, str]]:
    """Stamp and file name of every `kind` image in a TUM list; association lists hold two a line."""
    entries = []
    for number, line in enumerate(listing.read_text(encoding="utf-8").splitlines(), start=1):
        items = line.split("#", 1)[0].split()
        for stamp, name in zip(items[0::2], items[1::2], strict=False):
            if len(items) > 2 and kind not in Path(name).parts:
                continue
            if not _is_stamp(stamp):
                raise SequenceError(
                    f"{listing}, line {number}: {stamp!r} is no stamp: write `stamp file`, one line an image"
                )
            entries.append((stamp, name))
    return entries


def _is_stamp(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
