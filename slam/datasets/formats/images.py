"""Depth and colour images through OpenCV, which only a full installation has."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import SequenceError

EXR = ".exr"
FLOAT_SUFFIXES = (".tif", ".tiff", EXR)
_PNG = b"\x89PNG\r\n\x1a\n"


class MissingDependencyError(SequenceError):
    """A format that needs a package which a client's base installation leaves out."""


def _opencv() -> ModuleType:
    os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")  # most builds of OpenCV leave EXR off
    try:
        import cv2
    except ImportError:
        raise MissingDependencyError(
            "image files need OpenCV, which is not installed here: pip install opencv-python-headless, "
            "or use a sequence pack or a .raw file"
        ) from None
    return cv2


def read_depth(path: Path) -> npt.NDArray[np.uint16 | np.float32]:
    """A depth image as stored, (height, width), of 16 bits or of floating-point numbers.

    Raises SequenceError when it is anything else.
    """
    image = _decode(path, _opencv().IMREAD_UNCHANGED)
    if image.ndim != 2 or not (image.dtype == np.uint16 or np.issubdtype(image.dtype, np.floating)):
        raise SequenceError(
            f"{path} holds {image.dtype} {image.shape}, depth must be one channel of 16 bits or of "
            "floating-point numbers"
        )
    return image


def is_float(path: Path) -> bool:
    """Whether a depth image holds floating-point numbers; a PNG never does."""
    return path.suffix.lower() in FLOAT_SUFFIXES and read_depth(path).dtype != np.uint16


def write_depth(path: Path, depth: npt.NDArray[np.uint16]) -> None:
    """Write a 16-bit PNG."""
    if not _opencv().imwrite(str(path), depth):
        raise SequenceError(f"{path} could not be written as an image")


def read_colour(path: Path) -> npt.NDArray[np.uint8]:
    """A colour image, (height, width, 3), red green blue."""
    cv2 = _opencv()
    return np.ascontiguousarray(_decode(path, cv2.IMREAD_COLOR)[:, :, ::-1])


def _decode(path: Path, flags: int) -> npt.NDArray[Any]:
    cv2 = _opencv()
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SequenceError(f"{path} cannot be read: {error.strerror}") from None
    _check_png(data, path)
    image = _decoded(cv2, data, flags)
    if image is None and path.suffix.lower() == EXR:
        raise SequenceError(
            f"{path}: OpenCV cannot read this EXR file here: convert it to TIFF of 32-bit floats"
        )
    if image is None:
        raise SequenceError(f"{path} is not a readable image: copy or fetch it again")
    return image


def _decoded(cv2: ModuleType, data: bytes, flags: int) -> npt.NDArray[Any] | None:
    """The image that OpenCV decodes from bytes, None where it fails."""
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:  # such as a header that claims more pixels than OpenCV decodes
        return None
    return None if image is None else np.asarray(image)


def _check_png(data: bytes, path: Path) -> None:
    """Raise SequenceError for a damaged PNG, which libpng would report on standard error by itself."""
    if not data.startswith(_PNG):
        return
    offset, kind = len(_PNG), b""
    while kind != b"IEND":
        if offset + 12 > len(data):
            raise SequenceError(f"{path} is cut short after {len(data)} bytes: copy or fetch it again")
        (length,) = struct.unpack_from(">I", data, offset)
        kind = data[offset + 4 : offset + 8]
        end = offset + 8 + length
        if end + 4 > len(data):
            raise SequenceError(f"{path} is cut short after {len(data)} bytes: copy or fetch it again")
        if zlib.crc32(memoryview(data)[offset + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            raise SequenceError(f"{path} is damaged between bytes {offset} and {end}: copy or fetch it again")
        offset = end + 4


def png_size(path: Path) -> tuple[int, int] | None:
    """Width and height from the header of a PNG; None for any other or unreadable file."""
    try:
        with path.open("rb") as file:
            head = file.read(24)
    except OSError:
        return None
    if len(head) < 24 or not head.startswith(_PNG) or head[12:16] != b"IHDR":
        return None
    width, height = struct.unpack(">II", head[16:])
    return width, height


def image_size(path: Path) -> tuple[int, int] | None:
    """Width and height of an image: from the header of a PNG, otherwise decoded; None for a damaged PNG."""
    if path.suffix.lower() == ".png":
        return png_size(path)
    height, width = _decode(path, _opencv().IMREAD_UNCHANGED).shape[:2]
    return width, height


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
    """(height, width, 3), red green blue, of JPEG bytes. Raises SequenceError for other bytes."""
    cv2 = _opencv()
    image = _decoded(cv2, data, cv2.IMREAD_COLOR)
    if image is None:
        raise SequenceError(f"{len(data)} bytes are not a readable JPEG image")
    return np.ascontiguousarray(image[:, :, ::-1])
