"""RGB-D sequences: open any supported one with `open_sequence`."""

from __future__ import annotations

import os
from pathlib import Path

from slam.camera import Camera
from slam.datasets.formats.icl_nuim import IclNuimOriginal, IclNuimSequence, is_original_form, is_png_form
from slam.datasets.formats.pack import MANIFEST, Pack
from slam.datasets.formats.slambench.raw_file import RawSequence
from slam.datasets.formats.slambench.slam_file import SlamSequence
from slam.datasets.formats.tum import TumSequence
from slam.datasets.sequence import DigestError, Given, Sequence, SequenceError

__all__ = ["DigestError", "Sequence", "SequenceError", "open_sequence"]

FORMS = "a sequence pack, a TUM or ICL-NUIM folder, a .raw or a .slam file"


def open_sequence(
    path: str | os.PathLike[str],
    camera: Given = None,
    truth: str | os.PathLike[str] | None = None,
) -> Sequence:
    """Open a sequence pack, a TUM-layout or ICL-NUIM folder, or a `.raw` or `.slam` file of SLAMBench.

    `camera` gives the intrinsics where the files hold none or wrong ones: a Camera, or for files that know
    their own size the four numbers fx, fy, cx, cy. `truth` is a TUM trajectory that replaces the sequence's
    own. Raises SequenceError for any other path, damaged files, or intrinsics that do not fit
    the images, TrajectoryError for a bad truth.
    """
    place = Path(path)
    truth_path = Path(truth) if truth is not None else None
    if not place.exists():
        raise SequenceError(f"{place} does not exist: give {FORMS}")
    if place.is_dir() and (place / MANIFEST).exists():
        if camera is not None or truth is not None:
            raise SequenceError(f"{place} is a sequence pack, which contains its camera and truth: omit both")
        return Pack(place)
    if place.is_dir() and is_original_form(place):
        return IclNuimOriginal(place, camera, truth_path)
    if place.is_dir() and (place / "depth").is_dir():
        form = IclNuimSequence if is_png_form(place) else TumSequence
        return form(place, camera, truth_path)
    if place.is_file() and place.suffix == ".raw":
        if camera is None:
            raise SequenceError(f"{place} has no intrinsics: give the camera as fx,fy,cx,cy")
        return RawSequence(place, _numbers(camera), truth_path)
    if place.is_file() and place.suffix == ".slam":
        return SlamSequence(place, None if camera is None else _numbers(camera), truth_path)
    raise SequenceError(
        f"{place} is not a known sequence: expected a folder with {MANIFEST} (a pack), depth/ (TUM or "
        "ICL-NUIM) or scene_00_*.depth (ICL-NUIM's original form), or a .raw or .slam file of SLAMBench"
    )


def _numbers(camera: Camera | tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    return camera if isinstance(camera, tuple) else (camera.fx, camera.fy, camera.cx, camera.cy)
