"""RGB-D sequences: open any supported one with `open_sequence`."""

from __future__ import annotations

import os
from pathlib import Path

from slam.camera import Camera
from slam.datasets.pack import MANIFEST, Pack
from slam.datasets.sequence import DigestError, Sequence, SequenceError
from slam.datasets.slambench_raw import RawSequence
from slam.datasets.tum import TumSequence

__all__ = ["DigestError", "Sequence", "SequenceError", "open_sequence"]


def open_sequence(
    path: str | os.PathLike[str],
    camera: Camera | tuple[float, float, float, float] | None = None,
    truth: str | os.PathLike[str] | None = None,
) -> Sequence:
    """Open a sequence pack, a TUM-layout folder or a SLAMBench 1 `.raw` file.

    `camera` gives the intrinsics where the files hold none: a Camera, or for a `.raw` file the four numbers
    fx, fy, cx, cy, as it knows its own size. `truth` is a TUM trajectory that replaces the folder's own.
    Raises SequenceError when the path is none of these or is damaged, TrajectoryError for a bad truth.
    """
    place = Path(path)
    truth_path = Path(truth) if truth is not None else None
    if not place.exists():
        raise SequenceError(
            f"{place} does not exist: give a sequence pack, a TUM-layout folder or a .raw file"
        )
    if place.is_dir() and (place / MANIFEST).exists():
        if camera is not None or truth is not None:
            raise SequenceError(
                f"{place} is a sequence pack, which carries its camera and truth: give neither"
            )
        return Pack(place)
    if place.is_dir() and (place / "depth").is_dir():
        if isinstance(camera, tuple):
            raise SequenceError(f"{place}: a folder's camera needs its size as well: write intrinsics.txt")
        return TumSequence(place, camera, truth_path)
    if place.is_file() and place.suffix == ".raw":
        if camera is None:
            raise SequenceError(f"{place} carries no intrinsics: give the camera as fx,fy,cx,cy")
        if isinstance(camera, Camera):
            camera = (camera.fx, camera.fy, camera.cx, camera.cy)
        return RawSequence(place, camera, truth_path)
    raise SequenceError(
        f"{place} is no known sequence: expected a folder with {MANIFEST} (a pack) or depth/ (TUM layout), "
        "or a .raw file of SLAMBench 1"
    )
