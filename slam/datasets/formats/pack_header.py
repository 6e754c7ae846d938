"""Checks of a pack's manifest and header before their values are used."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.sequence import LARGEST_SIDE, LARGEST_VOLUME, SequenceError, check_camera
from slam.trajectories.stamps import LARGEST_STAMP
from slam.trajectories.trajectory import check_poses

DESCRIBED = ("name", "width", "height", "frames", "volume_size", "initial_position")
MOST_FRAMES = 10**6
INTRINSICS = ("fx", "fy", "cx", "cy")


def parse_object(text: str | bytes) -> dict[str, Any]:
    """The JSON object in `text`. Raises ValueError for anything else."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(value, dict):
        raise ValueError("it is not a JSON object")
    return value


def check_description(document: Mapping[str, Any], source: Path) -> None:
    """Raise SequenceError where what `document` says of a sequence (DESCRIBED) is missing or impossible."""
    missing = [key for key in DESCRIBED if key not in document]
    if missing:
        raise SequenceError(f"{source} lacks {', '.join(missing)}: fetch the pack again")
    if not isinstance(document["name"], str):
        raise _impossible(source, "name", document["name"], "a text")
    for key, most in (("width", LARGEST_SIDE), ("height", LARGEST_SIDE), ("frames", MOST_FRAMES)):
        if not _is_whole(document[key], most):
            raise _impossible(source, key, document[key], f"a whole number from 1 to {most}")
    size, start = document["volume_size"], document["initial_position"]
    if size is not None and not (_is_number(size) and 0 < size <= LARGEST_VOLUME):
        right = f"metres, above 0 and at most {LARGEST_VOLUME:g}, or null"
        raise _impossible(source, "volume_size", size, right)
    if start is not None and not _is_list_of_numbers(start, 3):
        raise _impossible(source, "initial_position", start, "three finite numbers, or null")


def check_chunks(header: Mapping[str, Any], chunks: int, source: Path) -> None:
    """Raise SequenceError where the frames of `header` do not fill `chunks`, of which the first is the
    header."""
    each = header.get("frames_per_chunk")
    if not _is_whole(each, MOST_FRAMES):
        raise _impossible(source, "frames_per_chunk", each, f"a whole number from 1 to {MOST_FRAMES}")
    needed = 1 + math.ceil(header["frames"] / each)
    if chunks != needed:
        frames = header["frames"]
        raise SequenceError(
            f"{source}: {frames} frames, {each} a chunk, take {needed} chunks, it has {chunks}: fetch the "
            "pack again"
        )


def camera_of(header: Mapping[str, Any], source: Path) -> Camera:
    """The camera of `header`. Raises SequenceError where it is impossible or of images of another size."""
    given, size = header.get("camera"), (header["width"], header["height"])
    if not isinstance(given, dict) or set(given) != {*INTRINSICS, "width", "height"}:
        raise _impossible(source, "camera", given, "an object with fx, fy, cx, cy, width and height")
    if (given["width"], given["height"]) != size:
        raise _impossible(source, "camera", given, f"of images of {size[0]}x{size[1]}")
    for name in INTRINSICS:
        if not _is_number(given[name]):
            raise _impossible(source, f"camera {name}", given[name], "a finite number of pixels")
    try:
        fx, fy, cx, cy = (float(given[name]) for name in INTRINSICS)
        camera = Camera(fx, fy, cx, cy, *size)
    except ValueError as error:
        raise SequenceError(f"{source}: {error}") from None
    check_camera(camera, source)
    return camera


def timestamps_of(header: Mapping[str, Any], source: Path) -> npt.NDArray[np.float64]:
    """The stamps of `header`, (frames,) in seconds.

    Raises SequenceError where one is missing or impossible.
    """
    stamps = header.get("timestamps")
    if not isinstance(stamps, list) or len(stamps) != header["frames"]:
        raise _impossible(source, "timestamps", stamps, f"a list of {header['frames']} numbers")
    for stamp in stamps:
        if not (_is_number(stamp) and abs(stamp) <= LARGEST_STAMP):
            raise _impossible(source, "a timestamp", stamp, f"seconds, at most {LARGEST_STAMP:g}")
    return np.array(stamps, np.float64)


def truth_of(header: Mapping[str, Any], source: Path) -> npt.NDArray[np.float64] | None:
    """The true poses of `header`, (frames, 4, 4), NaN where one is not known; None without truth.

    A row is the upper three rows of a pose, or null. Raises SequenceError for another form, TrajectoryError
    for a pose that is not a rigid motion.
    """
    rows = header.get("truth")
    if rows is None:
        return None
    if not isinstance(rows, list) or len(rows) != header["frames"]:
        raise _impossible(source, "truth", rows, f"null, or a list of {header['frames']} poses")
    truth = np.full((len(rows), 4, 4), np.nan)
    for number, row in enumerate(rows):
        if row is None:
            continue
        if not _is_list_of_numbers(row, 12):
            raise _impossible(source, f"the true pose of frame {number}", row, "12 finite numbers, or null")
        truth[number] = np.vstack([np.reshape(row, (3, 4)), [0, 0, 0, 1]])
    check_poses(truth, source, "the true pose of frame")
    return truth


def _is_number(value: Any) -> bool:
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # a whole number beyond every float
        return False


def _is_list_of_numbers(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(map(_is_number, value))


def _is_whole(value: Any, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _impossible(source: Path, key: str, value: Any, right: str) -> SequenceError:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of more digits, or deeper lists, than Python writes
        text = "a value too long to write"
    shown = text if len(text) <= 60 else text[:57] + "..."
    return SequenceError(f"{source}: {key} is {shown}: must be {right}")
