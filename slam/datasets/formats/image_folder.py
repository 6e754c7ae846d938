"""A folder with a depth image, and perhaps a colour image, for each frame."""

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
from slam.datasets.formats.intrinsics import read_intrinsics
from slam.datasets.formats.units import METRES, MILLIMETRES, check_units, to_millimetres
from slam.datasets.sequence import Given, Sequence, SequenceError, check_camera, file_sha256, make_camera

T = TypeVar("T", bound=np.generic)


class ImageFolder(Sequence):
    """Depth images of any unit, as millimetres, and colour images of those frames that have one.

    The camera is `camera`, else that of the folder's own file, else `usual_camera`. Depth has `units` a
    metre, else what the file says; else floating-point images are in metres and whole numbers have
    `usual_units` a metre.
    """

    def __init__(
        self,
        folder: Path,
        depth: list[Path],
        camera: Given,
        units: float | None,
        usual_camera: Camera | None = None,
        usual_units: float = MILLIMETRES,
    ) -> None:
        self.name = folder.resolve().name
        self._folder = folder
        self._depth = depth
        self._colour: dict[int, Path] = {}
        described = read_intrinsics(folder)
        size = images.image_size(depth[0])
        if isinstance(camera, tuple):
            if size is None:
                raise SequenceError(f"{depth[0]} is not an image with a size: copy it again")
            camera = make_camera(camera, size, folder)
        self.camera = self._given_or_read(camera, described[0] if described else usual_camera)
        if size is not None:
            self._check_size((size[1], size[0]), depth[0])
        check_camera(self.camera, folder)
        if units is not None:
            check_units(units, folder)
        elif described:
            units = described[1]
        else:
            units = METRES if images.is_float(depth[0]) else usual_units
            self.assumed_units = units
        self._units = units

    def _given_or_read(self, given: Camera | None, read: Camera | None) -> Camera:
        camera = given or read
        if camera is None:
            raise SequenceError(
                f"{self._folder / 'intrinsics.txt'} is missing: write fx fy cx cy width height "
                "depth_units_per_metre, or give the camera and the units"
            )
        return camera

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        return to_millimetres(self._checked(images.read_depth, self._depth[index]), self._units)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        if index not in self._colour:
            return None
        return self._checked(images.read_colour, self._colour[index])

    def _checked(self, read: Callable[[Path], npt.NDArray[T]], path: Path) -> npt.NDArray[T]:
        """The image at `path`; its size is compared before a file that claims a huge one is decoded."""
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
