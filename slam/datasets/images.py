"""Depth and colour images through OpenCV, which only a full installation has."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import SequenceError


class MissingDependencyError(SequenceError):
    """A format that needs a package which a client's base installation leaves out."""


def _opencv() -> ModuleType:
    try:
        import cv2
    except ImportError:
        raise MissingDependencyError(
            "image files need OpenCV, which is not installed here: pip install opencv-python-headless, "
            "or use a sequence pack or a .raw file"
        ) from None
    return cv2


def read_depth(path: Path) -> npt.NDArray[np.uint16]:
    """A 16-bit depth image as stored, (height, width). Raises SequenceError when it is anything else."""
    cv2 = _opencv()
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise SequenceError(f"{path} is not a readable image")
    if image.dtype != np.uint16 or image.ndim != 2:
        raise SequenceError(f"{path} holds {image.dtype} {image.shape}, depth must be one channel of 16 bits")
    return np.asarray(image)


def write_depth(path: Path, depth: npt.NDArray[np.uint16]) -> None:
    """Write a 16-bit PNG."""
    if not _opencv().imwrite(str(path), depth):
        raise SequenceError(f"{path} could not be written as an image")


def read_colour(path: Path) -> npt.NDArray[np.uint8]:
    """A colour image, (height, width, 3), red green blue."""
    cv2 = _opencv()
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SequenceError(f"{path} is not a readable image")
    return np.ascontiguousarray(image[:, :, ::-1])


def write_colour(path: Path, colour: npt.NDArray[np.uint8]) -> None:
    """Write (height, width, 3), red green blue, in the format of the path's suffix."""
    if not _opencv().imwrite(str(path), np.ascontiguousarray(colour[:, :, ::-1])):
        raise SequenceError(f"{path} could not be written as an image")


def encode_jpeg(colour: npt.NDArray[np.uint8], quality: int) -> bytes:
    """JPEG bytes of (height, width, 3), red green blue."""
    cv2 = _opencv()
    done, data = cv2.imencode(
        ".jpg", np.ascontiguousarray(colour[:, :, ::-1]), [cv2.IMWRITE_JPEG_QUALITY, quality]
    )
    if not done:
        raise SequenceError(f"an image of shape {colour.shape} could not be written as JPEG")
    return bytes(data)


def decode_jpeg(data: bytes) -> npt.NDArray[np.uint8]:
    """(height, width, 3), red green blue, of JPEG bytes. Raises SequenceError when they are none."""
    cv2 = _opencv()
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise SequenceError(f"{len(data)} bytes are not a readable JPEG image")
    return np.ascontiguousarray(image[:, :, ::-1])
