"""Which layout of a system's kernels is fastest on a device: measured once and remembered."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.devices.build import DEFAULT, Build
from slam.devices.device import Device, DeviceError
from slam.devices.layout import Layout
from slam.devices.opencl import Session
from slam.system import Scene, System

GROUPS = ((16, 8), (8, 8), (32, 4), (64, 2), (32, 8))
SCENE = Scene(Camera(270.0, 270.0, 159.5, 119.5, 320, 240), 4.0, (0.5, 0.5, 0.1))
FRAMES = 12
FIRST_JUDGED = 6  # KinectFusion does not track the first 4, and the next compile what is left
Progress = Callable[[int, int], object]  # called with how many are done, and how many there are


@dataclass(frozen=True)
class Trial:
    """A trial on a device: a system made for SCENE, with kernels from the folders `kernels`."""

    make: Callable[[Session], System]
    kernels: tuple[Path, ...]

    def seconds(
        self,
        device: Device,
        layout: Layout,
        progress: Callable[[int], object],
        build: Build = DEFAULT,
    ) -> float:
        """Median wall seconds of a frame that tracks and raycasts a wavy wall which moves; infinite where the
        device refuses the layout. `progress` is called before each frame with the number of those done."""
        images = [wavy_wall(SCENE.camera, shift=number) for number in range(FRAMES)]
        try:
            system = self.make(Session(device, layout, build))
            seconds: list[float] = []
            for wall, painted in images:
                progress(len(seconds))
                began = perf_counter()
                system.process(wall, painted)
                seconds.append(perf_counter() - began)
        except DeviceError:
            return float("inf")
        return median(seconds[FIRST_JUDGED:])

    def key(self, device: Device, build: Build = DEFAULT) -> str:
        """The device, the kernels and their build: new kernels and other builds are tried again."""
        digest = hashlib.sha256()
        for source in sorted(path for folder in self.kernels for path in folder.glob("*.[ch]*")):
            digest.update(source.read_bytes())
        return f"{device.label} {digest.hexdigest()[:16]}{'' if build == DEFAULT else f' {build}'}"


def wavy_wall(camera: Camera, shift: int = 0) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint8]]:
    """Depth (height, width) in millimetres and colour (height, width, 3) that hold a camera in every way.

    `shift` moves the wall by so many pixels.
    """
    y, x = np.mgrid[: camera.height, : camera.width]
    x = x + shift
    wall = (1600 + 200 * np.sin(x / 37.0) + 100 * np.cos(y / 23.0)).astype(np.uint16)
    painted = np.repeat((128 + 90 * np.sin(x / 7.0) * np.cos(y / 5.0)).astype(np.uint8)[..., None], 3, 2)
    return wall, painted


def layout_for(
    device: Device, trial: Trial, progress: Progress | None = None, build: Build = DEFAULT
) -> Layout:
    """The fastest layout on `device`: that of `build`, the user's (FRONTRUNNER_KERNELS), the remembered one,
    or a new trial's.

    A trial takes a second or two on a device that was never seen with these kernels, minutes on a slow phone:
    `progress` counts its frames.
    """
    if build.layout:
        return build.layout
    if os.environ.get("FRONTRUNNER_KERNELS"):
        return Layout.for_device(device.kind)
    path, key = _cache_file(), trial.key(device, build)
    remembered = _read(path)
    if key in remembered:
        kind, width, height = remembered[key]
        return Layout(kind, (width, height))
    tried = candidates(device)

    def report(frames: int, layouts: int = 0) -> None:
        if progress:
            progress(layouts * FRAMES + frames, len(tried) * FRAMES)

    seconds = {}
    for number, layout in enumerate(tried):
        report(0, number)
        seconds[layout] = trial.seconds(device, layout, partial(report, layouts=number), build)
    report(0, len(tried))
    best = min(tried, key=seconds.__getitem__)
    if seconds[best] < float("inf"):
        _remember(path, key, best)
    return best


def candidates(device: Device) -> list[Layout]:
    """The layouts to try: on CPUs rows and one shape of pixels, elsewhere every shape of pixels."""
    if device.kind == "cpu":
        return [Layout("rows"), Layout("pixels", GROUPS[0])]
    return [Layout("pixels", group) for group in GROUPS]


def _cache_file() -> Path:
    if sys.platform == "win32":
        folder = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        folder = Path.home() / "Library" / "Caches"
    else:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return folder / "frontrunner" / "layouts.json"


def _read(path: Path) -> dict[str, tuple[str, int, int]]:
    """The remembered layouts; nothing where the file is missing or not valid."""
    try:
        content = json.loads(path.read_text())
        return {key: (str(kind), int(w), int(h)) for key, (kind, w, h) in content.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _remember(path: Path, key: str, layout: Layout) -> None:
    """Write the file again and move it into place; a folder that cannot be written is not an error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_suffix(f".{os.getpid()}")
        fresh.write_text(json.dumps(_read(path) | {key: (layout.kind, *layout.group)}, indent=1))
        fresh.replace(path)
    except OSError:
        return
