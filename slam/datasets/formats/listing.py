"""The images of a folder in order, with stamps from lists, from file names, or from frame numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import FRAME_RATE, SequenceError
from slam.trajectories.stamps import LARGEST_STAMP, is_nanoseconds, read_stamp
from slam.trajectories.text_files import read_text

IMAGES = (".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff", ".exr")

Numbers = npt.NDArray[np.int64]


def listed(folder: Path, kind: str) -> tuple[list[Path], npt.NDArray[np.float64], Numbers | None]:
    """Images of `kind` in order, their stamps, and their numbers where they have only numbers.

    Raises SequenceError for a bad line of a list, and for a file name that is neither a number nor a stamp.
    """
    for listing in (folder / f"{kind}.txt", folder / "associations.txt"):
        if listing.exists():
            entries = _entries(listing, kind)
            if entries:
                entries.sort(key=lambda entry: float(entry[0]))
                return [folder / name for _, name in entries], *_timed([stamp for stamp, _ in entries])
    files = [path for path in (folder / kind).glob("*") if path.suffix.lower() in IMAGES]
    digits = {path: re.sub(r"\D", "", path.stem) for path in files}
    if all(re.fullmatch(r"\D*\d+\D*", path.stem) for path in files):
        files.sort(key=lambda path: int(digits[path]))
        if files and all(is_nanoseconds(int(digits[path])) for path in files):
            return files, np.array([int(digits[path]) / 1e9 for path in files]), None
        numbers = np.array([frame_number(digits[path], path) for path in files], dtype=np.int64)
        return files, numbers / FRAME_RATE, numbers
    stamped = []
    for path in files:
        stamp = read_stamp(path.stem)
        if stamp is None:
            raise SequenceError(
                f"{path}: {path.stem!r} is not a number or a stamp in seconds: name images by one of them, "
                f"or list them in {kind}.txt"
            )
        stamped.append((stamp, path))
    stamped.sort()
    return [path for _, path in stamped], np.array([stamp for stamp, _ in stamped]), None


def _timed(texts: list[str]) -> tuple[npt.NDArray[np.float64], Numbers | None]:
    """Seconds of stamps, and frame numbers where the stamps are those: all written without a point."""
    stamps = np.array([read_stamp(text) for text in texts], dtype=np.float64)
    if all(text.isdecimal() and not is_nanoseconds(int(text)) for text in texts):
        return stamps / FRAME_RATE, stamps.astype(np.int64)
    return stamps, None


def _entries(listing: Path, kind: str) -> list[tuple[str, str]]:
    """Stamp and file name of every `kind` image in a TUM list; association lists hold two a line."""
    entries = []
    for number, line in enumerate(read_text(listing, SequenceError).splitlines(), start=1):
        items = line.split("#", 1)[0].split()
        for stamp, name in zip(items[0::2], items[1::2], strict=False):
            if len(items) > 2 and kind not in Path(name).parts:
                continue
            if read_stamp(stamp) is None:
                raise SequenceError(
                    f"{listing}, line {number}: {stamp!r} is not a stamp: write `stamp file`, a line an image"
                )
            if not name.isprintable():
                raise SequenceError(f"{listing}, line {number}: {name!r} is not the name of a file")
            entries.append((stamp, name))
    return entries


def frame_number(digits: str, path: Path) -> int:
    """The number of a frame whose file `path` has `digits` in its name.

    Raises SequenceError where it is too large for the frame to have a stamp.
    """
    number = int(digits)
    if number > LARGEST_STAMP:
        raise SequenceError(f"{path}: the frame number {digits} is too large: name frames from 0 on")
    return number
