"""Shaded pictures of the model, as the camera sees it while a system runs."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.datasets.formats.images import MissingDependencyError, write_colour
from slam.system import System, View

BACKGROUND = (22, 24, 30)  # red green blue, where no surface is seen
SURFACE = np.array([235.0, 232.0, 225.0])
AMBIENT = 0.15


def shade(view: View) -> NDArray[np.uint8]:
    """A picture (height, width, 3), red green blue: surfaces lit from the camera (Lambert), in their colour
    where the view has one.
    """
    towards_eye = view.eye - view.vertices
    distance = np.linalg.norm(towards_eye, axis=2)
    seen = view.normals.any(axis=2) & (distance > 0)
    cosine = np.einsum("yxi,yxi->yx", towards_eye, view.normals) / np.where(seen, distance, 1)
    brightness = AMBIENT + (1 - AMBIENT) * np.clip(cosine, 0, 1)
    picture = np.empty((*seen.shape, 3), np.uint8)
    picture[:] = BACKGROUND
    surface = SURFACE if view.colour is None else view.colour[seen]
    picture[seen] = (brightness[seen, None] * surface).astype(np.uint8)
    return picture


class Renderer:
    """An observer of `slam.benchmark.run` that writes a PNG of every `every`-th frame into a folder.

    Files are named by the frame; frames before the model exists have none. Pictures are of the computation's
    size. Raises MissingDependencyError where OpenCV is not installed and OSError where the folder cannot be
    made.
    """

    def __init__(self, folder: Path, every: int) -> None:
        if find_spec("cv2") is None:
            raise MissingDependencyError(
                "pictures need OpenCV, which is not installed here: pip install opencv-python-headless"
            )
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._every = every
        self.written = 0

    def __call__(self, index: int, system: System) -> None:
        if index % self._every:
            return
        view = system.view()
        if view is not None:
            write_colour(self._folder / f"{index:06}.png", shade(view))
            self.written += 1
