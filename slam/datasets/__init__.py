"""RGB-D sequences: open any supported one with `open_sequence`."""

from __future__ import annotations

import os
from pathlib import Path

from slam.camera import Camera
from slam.datasets.formats.icl_nuim import IclNuimOriginal, IclNuimSequence, is_original_form, is_png_form
from slam.datasets.formats.image_folder import ImageFolder
from slam.datasets.formats.pack import MANIFEST, Pack
from slam.datasets.formats.ros_bag import RosBag, is_ros_bag
from slam.datasets.formats.seven_scenes import SevenScenes, is_seven_scenes
from slam.datasets.formats.slambench.raw_file import RawSequence
from slam.datasets.formats.slambench.slam_file import SlamSequence
from slam.datasets.formats.tum import TumSequence
from slam.datasets.sequence import (
    UPWARD_SUFFIX,
    DigestError,
    Given,
    Sequence,
    SequenceError,
)
from slam.trajectories.readings import Axes, mirror_y

__all__ = ["DigestError", "Sequence", "SequenceError", "open_sequence"]

FORMS = "a pack, a folder of images (TUM, Open3D, 7-Scenes, ICL-NUIM), a bag of ROS, a .raw or a .slam file"
CONVERTED = {
    ".klg": "write its frames as images with convert_klg -depthpng (martinruenz/dataset-tools)",
    ".sens": "write its frames as images with ScanNet's SensReader (reader.py --export_depth_images)",
}


def open_sequence(
    path: str | os.PathLike[str],
    camera: Given = None,
    truth: str | os.PathLike[str] | None = None,
    units: float | None = None,
    truth_axes: Axes | None = None,
) -> Sequence:
    """Open a sequence pack, a folder of images, a bag of ROS, or a `.raw` or `.slam` file.

    `camera` gives the intrinsics where the files hold none or wrong ones: a Camera, or for files that know
    their own size the four numbers fx, fy, cx, cy. `truth` is a TUM trajectory that replaces the sequence's
    own. `units` are the depth units per metre of images in a folder or a bag. `truth_axes` are those of the
    true poses; without it files called `*.freiburg` have ICL-NUIM's. Raises SequenceError for any other path,
    damaged files, or intrinsics that do not fit the images, TrajectoryError for a bad truth.
    """
    location = Path(path)
    truth_path = Path(truth) if truth is not None else None
    sequence = _open(location, camera, truth_path, units)
    if isinstance(sequence, Pack) and any(item is not None for item in (camera, truth, units, truth_axes)):
        raise SequenceError(f"{location} is a pack, which contains its camera, units and truth: omit them")
    if units is not None and not isinstance(sequence, ImageFolder | RosBag):
        raise SequenceError(f"{location} says its units itself: omit --units")
    if truth_path is not None:
        sequence.truth_axes = "y-up" if truth_path.suffix == UPWARD_SUFFIX else "opencv"
    if truth_axes not in (None, sequence.truth_axes) and sequence.truth is not None:
        sequence.truth, sequence.truth_axes = mirror_y(sequence.truth), truth_axes
    return sequence


def _open(path: Path, camera: Given, truth: Path | None, units: float | None) -> Sequence:
    if not path.exists():
        raise SequenceError(f"{path} does not exist: give {FORMS}")
    if path.is_dir() and (path / MANIFEST).exists():
        return Pack(path)
    if path.is_dir() and is_original_form(path):
        return IclNuimOriginal(path, camera, truth)
    if path.is_dir() and is_seven_scenes(path):
        return SevenScenes(path, camera, truth, units)
    if path.is_dir() and (path / "depth").is_dir():
        form = IclNuimSequence if is_png_form(path) else TumSequence
        return form(path, camera, truth, units)
    if is_ros_bag(path):
        return RosBag(path, camera, truth, units)
    if path.is_file() and path.suffix == ".raw":
        if camera is None:
            raise SequenceError(f"{path} has no intrinsics: give the camera as fx,fy,cx,cy")
        return RawSequence(path, _numbers(camera), truth)
    if path.is_file() and path.suffix == ".slam":
        return SlamSequence(path, None if camera is None else _numbers(camera), truth)
    if path.suffix in CONVERTED:
        raise SequenceError(
            f"{path}: {path.suffix} files are not read: {CONVERTED[path.suffix]}, then open their folder "
            "with --camera and --units 1000"
        )
    raise SequenceError(
        f"{path} is not a known sequence: expected a folder with {MANIFEST} (a pack), depth/ (TUM, Open3D, "
        "ICL-NUIM), frame-*.depth.png (7-Scenes) or scene_00_*.depth (ICL-NUIM's original form), a bag of "
        "ROS, or a .raw or .slam file of SLAMBench"
    )


def _numbers(camera: Camera | tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    return camera if isinstance(camera, tuple) else (camera.fx, camera.fy, camera.cx, camera.cy)
