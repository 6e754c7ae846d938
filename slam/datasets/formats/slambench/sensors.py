"""The sensors in the header of a `.slam` file.

A sensor: u8 length and name, u8 length and type, u8 index, u32 length and description, f32 rate, 16 f32 pose
by columns, then what its type adds; lengths of texts count the final NUL. Cameras and depth sensors add u32
frame format, u32 pixel format, u32 width, u32 height and f32 fx, fy, cx, cy divided by the size, and then
what Layout describes.
"""

from __future__ import annotations

import itertools
import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slam.camera import Camera

RASTER = 1
GREY_8, RGB_888, DEPTH_16, RGBA_8888 = 1, 2, 5, 7
PIXEL_BYTES = {GREY_8: 1, RGB_888: 3, 3: 1, 4: 4, DEPTH_16: 2, 6: 8, RGBA_8888: 4}
MILLIMETRES = (0.001, 0.0)  # disparity parameters: metres = 0.001 d + 0
AFFINE = 0
_IMAGE = struct.Struct("<4I4f")
# Bytes that sensors other than cameras add to the header, and bytes of their frames; None: given per frame.
_OTHERS: dict[str, tuple[int, int | None]] = {
    "GroundTruthTrajectory": (0, 64),
    "PointCloud": (0, None),
    "Accelerometer": (72, 12),
    "Gyro": (72, 12),
    "IMU": (32, 24),
}


@dataclass(frozen=True)
class Layout:
    """The fields of a sensor that differ between releases of SLAMBench.

    delay: f32 behind the pose. camera: how many distortions of 5 f32 follow the u32 distortion type of a
    camera. depth: "none", or where a depth sensor's distortion (u32 type, 5 f32) lies to its disparity (2 f32
    parameters, u32 type): "after" or "before".
    """

    delay: bool = False
    camera: int = 1
    depth: str = "after"


# The second is what the newest SLAMBench 3 reads; the first what SLAMBench 2 grew into.
SLAMBENCH_2 = Layout()
SLAMBENCH_3 = Layout(delay=True, camera=3)
LAYOUTS = [
    Layout(*parts) for parts in itertools.product((False, True), (1, 2, 3), ("after", "none", "before"))
]


@dataclass(frozen=True)
class Sensor:
    kind: str
    pose: npt.NDArray[np.float64]
    frame_bytes: int | None
    frame_format: int = 0
    pixel_format: int = 0
    width: int = 0
    height: int = 0
    intrinsics: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    disparity: tuple[float, float] = MILLIMETRES
    disparity_type: int = AFFINE


class LayoutError(Exception):
    """The header makes no sense by the layout that was tried."""


def pack_sensor(kind: str, number: int, camera: Camera, layout: Layout) -> bytes:
    """The bytes of a sensor: Depth (16 bits, millimetres), Camera (RGB) or GroundTruthTrajectory."""
    name = {"Depth": "Depth", "Camera": "RGB"}.get(kind, "GroundTruth")
    parts = [struct.pack("<B", len(text) + 1) + text.encode() + b"\0" for text in (name, kind)]
    parts.append(struct.pack("<BI", number, len(name) + 1) + name.encode() + b"\0")
    parts.append(struct.pack("<f", 30) + np.eye(4, dtype="<f4").tobytes())
    if layout.delay:
        parts.append(struct.pack("<f", 0))
    if kind not in ("Depth", "Camera"):
        return b"".join(parts)
    c = camera
    normalised = (c.fx / c.width, c.fy / c.height, c.cx / c.width, c.cy / c.height)
    pixels = DEPTH_16 if kind == "Depth" else RGB_888
    parts.append(_IMAGE.pack(RASTER, pixels, c.width, c.height, *normalised))
    undistorted = bytes(4 + 20)
    if kind == "Camera":
        parts.append(undistorted + bytes(20 * (layout.camera - 1)))
    else:
        disparity = struct.pack("<2fI", *MILLIMETRES, AFFINE)
        parts += {
            "none": [disparity],
            "after": [disparity, undistorted],
            "before": [undistorted, disparity],
        }[layout.depth]
    return b"".join(parts)


def parse_sensors(header: bytes, place: int, count: int, layout: Layout) -> tuple[list[Sensor], int]:
    """The `count` sensors from byte `place` on by their index, and where the frames begin.

    Raises LayoutError when they make no sense by `layout`.
    """
    sensors: dict[int, Sensor] = {}
    try:
        for _ in range(count):
            _, place = _text(header, place, "<B")
            kind, place = _text(header, place, "<B")
            index = header[place]
            _, place = _text(header, place + 1, "<I")
            pose = np.array(struct.unpack_from("<16f", header, place + 4)).reshape(4, 4).T
            place += 68 + 4 * layout.delay
            if index in sensors:
                raise LayoutError(f"two sensors have the index {index}")
            sensors[index], place = _parse_specific(header, place, kind, pose, layout)
    except (struct.error, IndexError, ValueError) as error:
        raise LayoutError(f"it ends within a sensor ({error})") from None
    if sorted(sensors) != list(range(count)):
        raise LayoutError(f"the sensors have the indices {sorted(sensors)}")
    return [sensors[index] for index in range(count)], place


def _text(header: bytes, place: int, length: str) -> tuple[str, int]:
    (size,) = struct.unpack_from(length, header, place)
    place += struct.calcsize(length)
    data = header[place : place + size]
    if len(data) != size or not data.endswith(b"\0") or b"\0" in data[:-1]:
        raise LayoutError(f"no text ends at byte {place + size}")
    return data[:-1].decode("latin-1"), place + size


def _parse_specific(
    header: bytes, place: int, kind: str, pose: npt.NDArray[np.float64], layout: Layout
) -> tuple[Sensor, int]:
    if kind in _OTHERS:
        more, frame_bytes = _OTHERS[kind]
        return Sensor(kind, pose, frame_bytes), place + more
    if kind not in ("Camera", "Depth"):
        raise LayoutError(f"sensors of type {kind!r} are not known here")
    form, pixels, width, height, fx, fy, cx, cy = _IMAGE.unpack_from(header, place)
    if not (1 <= form <= 3 and pixels in PIXEL_BYTES and 0 < width <= 16384 and 0 < height <= 16384):
        raise LayoutError(f"a {kind} of {width}x{height} has frame format {form}, pixel format {pixels}")
    place += _IMAGE.size
    disparity, disparity_type = MILLIMETRES, AFFINE
    if kind == "Camera":
        place = _skip_distortion(header, place, layout.camera)
    else:
        if layout.depth == "before":
            place = _skip_distortion(header, place, 1)
        scale, offset, disparity_type = struct.unpack_from("<2fI", header, place)
        disparity = (scale, offset)
        if disparity_type > 1 or not (np.isfinite(disparity).all() and 1e-6 < abs(scale) < 1e3):
            raise LayoutError(f"depth has the disparity {disparity} of type {disparity_type}")
        place += 12
        if layout.depth == "after":
            place = _skip_distortion(header, place, 1)
    size = width * height * PIXEL_BYTES[pixels]
    return Sensor(
        kind, pose, size, form, pixels, width, height, (fx, fy, cx, cy), disparity, disparity_type
    ), place


def _skip_distortion(header: bytes, place: int, count: int) -> int:
    (kind,) = struct.unpack_from("<I", header, place)
    if kind > 3:
        raise LayoutError(f"the distortion type {kind} does not exist")
    return place + 4 + 20 * count
