"""Write a sequence in any format, and report what that format cannot hold."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from slam.datasets.formats import icl_nuim, pack, tum
from slam.datasets.formats.slambench import raw_file, sensors, slam_file
from slam.datasets.sequence import Progress, Sequence, SequenceError

FORMATS = ("pack", "tum", "icl", "icl-original", "raw", "slam", "slam3")
_SUFFIXES = {".raw": "raw", ".slam": "slam"}
_FILES = ("raw", "slam", "slam3")


def form_of(target: Path, form: str | None = None) -> str:
    """The form to write: `form` when given, otherwise by the suffix of `target`, otherwise a pack."""
    return form or _SUFFIXES.get(target.suffix, "pack")


def check_target(source: Path, target: Path, form: str) -> None:
    """Raise SequenceError when writing `target` would destroy its source or cannot begin."""
    if target.resolve() == source.resolve():
        raise SequenceError(f"{target} is the source itself: choose another target")
    if form in _FILES:
        if target.is_dir():
            raise SequenceError(
                f"{target} is a folder, the form {form} is one file: name it, or --format pack"
            )
        if not target.parent.is_dir():
            raise SequenceError(f"{target} cannot be written: there is no folder {target.parent}")
    elif target.exists() and not target.is_dir():
        raise SequenceError(f"{target} is a file, the form {form} is a folder: choose another target")
    elif form != "pack" and target.is_dir() and any(target.iterdir()):
        raise SequenceError(f"{target} is not empty, its files would mix with the new ones: choose another")


def write(
    sequence: Sequence, target: Path, form: str, colour: bool = False, progress: Progress | None = None
) -> list[str]:
    """Write `sequence` and return what was lost, a sentence each.

    `colour` adds the pack of colour to a pack; the other forms take colour where there is any. When a frame
    cannot be read nothing is left behind, unless the target held something before.
    """
    fresh = form not in _FILES and not (target.exists() and any(target.iterdir()))
    try:
        _write(sequence, target, form, colour, progress)
    except BaseException:
        if fresh:
            shutil.rmtree(target, ignore_errors=True)
        raise
    return _losses(sequence, form)


def _write(sequence: Sequence, target: Path, form: str, colour: bool, progress: Progress | None) -> None:
    if form == "tum":
        tum.write(sequence, target, progress)
    elif form == "icl":
        icl_nuim.write(sequence, target, progress)
    elif form == "icl-original":
        icl_nuim.write_original(sequence, target, progress)
    elif form == "raw":
        raw_file.write(sequence, target, progress)
    elif form in ("slam", "slam3"):
        layout = sensors.SLAMBENCH_2 if form == "slam" else sensors.SLAMBENCH_3
        slam_file.write(sequence, target, progress, layout)
    else:
        written = pack.write(sequence, target, progress)
        if colour:
            pack.write_colour(sequence, written, target.with_name(target.name + "-colour"), progress)


def _losses(sequence: Sequence, form: str) -> list[str]:
    camera, losses = sequence.camera, []
    numbers = f"{camera.fx:g},{camera.fy:g},{camera.cx:g},{camera.cy:g}"
    if form == "raw":
        losses.append(f"a .raw file holds no camera: open it with --camera {numbers}")
        if sequence.truth is not None:
            losses.append("a .raw file holds no truth: give --truth with it")
    expected = (icl_nuim.CAMERA.width, icl_nuim.CAMERA.height)
    if form == "icl-original" and (camera.width, camera.height) != expected:
        losses.append(f"the form holds no size and {camera.width}x{camera.height} is not ICL-NUIM's")
    elif form == "icl-original" and numbers != "481.2,480,319.5,239.5":
        losses.append(f"the form holds no camera: open it with --camera {numbers}")
    if form == "icl" and _furthest(sequence) > 13107:
        losses.append("depth beyond 13.107 m does not fit 5000 units a metre and is not measured there")
    if form in ("raw", "icl", "icl-original") and len(sequence) > 1:
        steps = np.diff(sequence.timestamps)
        if not np.allclose(steps, 1 / 30, atol=0.002):
            losses.append("the form holds no stamps: frames count as 30 a second")
    if form != "pack" and sequence.volume_size is not None:
        start = ",".join(f"{x:g}" for x in sequence.initial_position or ())
        options = f"--volume-size {sequence.volume_size:g}" + (
            f" --initial-position {start}" if start else ""
        )
        losses.append(f"only packs hold volume size and start: run it with {options}")
    return losses


def _furthest(sequence: Sequence) -> int:
    """Of the first, the middle and the last frame."""
    return max(int(sequence.depth(i).max()) for i in {0, len(sequence) // 2, len(sequence) - 1})
