"""`.slam` files of SLAMBench 2 and 3 (version 1, little-endian, packed).

`SLAM\\0`, u32 version, u32 number of sensors, the sensors (sensors.py), then frames to the end of the
file: u32 seconds, u32 nanoseconds, u8 sensor, u32 size (point clouds only) and the payload. SLAMBench changed
how it writes sensors several times and kept the version, so the reader tries every layout that there was and
takes the one by which the file adds up.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.formats.output import whole_file
from slam.datasets.formats.slambench.sensors import (
    AFFINE,
    DEPTH_16,
    LAYOUTS,
    RASTER,
    RGB_888,
    RGBA_8888,
    SLAMBENCH_2,
    Layout,
    LayoutError,
    Sensor,
    pack_sensor,
    parse_sensors,
)
from slam.datasets.sequence import (
    Progress,
    Sequence,
    SequenceError,
    make_camera,
    match_truth,
    read_truth,
)
from slam.trajectories.trajectory import Trajectory, associate

MAGIC = b"SLAM\0"
VERSION = 1
_HEADER = 64 * 1024  # bytes that hold any header of some sensors


@dataclass(frozen=True)
class _Frame:
    seconds: float
    sensor: int
    offset: int
    size: int


class SlamSequence(Sequence):
    """The first depth sensor, the first colour camera and the true trajectory of a file.

    The lens distortion that a file may tell is not undone.
    """

    def __init__(
        self,
        path: Path,
        intrinsics: tuple[float, float, float, float] | None = None,
        truth: Path | None = None,
    ) -> None:
        self.name = path.stem
        self._path = path
        sensors, frames = _read_index(path)
        depth = next((i for i, sensor in enumerate(sensors) if sensor.kind == "Depth"), None)
        if depth is None:
            kinds = ", ".join(sensor.kind for sensor in sensors) or "none"
            raise SequenceError(f"{path} has no depth sensor, its sensors are: {kinds}")
        self._sensor = sensors[depth]
        self._check_depth()
        self._depth = [frame for frame in frames if frame.sensor == depth]
        if not self._depth:
            raise SequenceError(f"{path} holds no depth frame")
        self.timestamps = np.array([frame.seconds for frame in self._depth])
        self.camera = self._camera(intrinsics)
        self._find_colour(sensors, frames)
        if truth is not None:
            self.truth = read_truth(truth, self.camera, self.timestamps, np.arange(len(self._depth)))
        else:
            self._find_truth(sensors, frames)

    def _check_depth(self) -> None:
        sensor = self._sensor
        if (sensor.frame_format, sensor.pixel_format, sensor.disparity_type) != (RASTER, DEPTH_16, AFFINE):
            raise SequenceError(
                f"{self._path}: depth with frame format {sensor.frame_format}, pixel format "
                f"{sensor.pixel_format} and disparity type {sensor.disparity_type}: only raster images "
                f"({RASTER}) of 16 bits ({DEPTH_16}) with affine disparity ({AFFINE}) can be read"
            )

    def _camera(self, intrinsics: tuple[float, float, float, float] | None) -> Camera:
        width, height = self._sensor.width, self._sensor.height
        if intrinsics is None:
            fx, fy, cx, cy = self._sensor.intrinsics
            intrinsics = (fx * width, fy * height, cx * width, cy * height)
        return make_camera(intrinsics, (width, height), self._path)

    def _find_colour(self, sensors: list[Sensor], frames: list[_Frame]) -> None:
        self._colour: dict[int, _Frame] = {}
        size = (self.camera.width, self.camera.height)
        for number, sensor in enumerate(sensors):
            readable = sensor.frame_format == RASTER and sensor.pixel_format in (RGB_888, RGBA_8888)
            if sensor.kind == "Camera" and readable and (sensor.width, sensor.height) == size:
                colour = [frame for frame in frames if frame.sensor == number]
                stamps = np.array([frame.seconds for frame in colour])
                for frame, row in zip(*associate(self.timestamps, stamps, 0.02), strict=True):
                    self._colour[int(frame)] = colour[row]
                return

    def _find_truth(self, sensors: list[Sensor], frames: list[_Frame]) -> None:
        """The recorded trajectory is the body's, which is the camera's when that is not mounted apart.

        The pose of the trajectory's own sensor says nothing: SLAMBench leaves it unset for some datasets.
        """
        for number, sensor in enumerate(sensors):
            recorded = [frame for frame in frames if frame.sensor == number]
            if sensor.kind != "GroundTruthTrajectory" or not recorded:
                continue
            if not np.allclose(self._sensor.pose, np.eye(4), atol=1e-5):
                raise SequenceError(
                    f"{self._path}: its true trajectory is the body's, and the depth camera is mounted "
                    "elsewhere on it: give the camera's own with --truth"
                )
            data = b"".join(self._read(frame) for frame in recorded)
            with np.errstate(invalid="ignore"):  # what is not a number is refused below
                columns = np.frombuffer(data, "<f4").astype(np.float64).reshape(-1, 4, 4)
            stamps = np.array([frame.seconds for frame in recorded])
            trajectory = Trajectory(stamps, np.swapaxes(columns, 1, 2))
            self.truth = match_truth(trajectory, self.timestamps, None, self._path)
            return

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        shape = (self.camera.height, self.camera.width)
        stored = np.frombuffer(self._read(self._depth[index]), "<u2").reshape(shape)
        scale, offset = (1000 * value for value in self._sensor.disparity)
        if np.isclose(scale, 1) and offset == 0:
            return stored.astype(np.uint16)
        millimetres = np.rint(stored * scale + offset)
        measured = (stored > 0) & (millimetres >= 0) & (millimetres <= 65535)
        return np.where(measured, millimetres, 0).astype(np.uint16)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        if index not in self._colour:
            return None
        data = np.frombuffer(self._read(self._colour[index]), np.uint8)
        return data.reshape(self.camera.height, self.camera.width, -1)[:, :, :3]

    def _read(self, frame: _Frame) -> bytes:
        with self._path.open("rb") as file:
            file.seek(frame.offset)
            return file.read(frame.size)

    @cached_property
    def sha256(self) -> str:
        """Over the whole file."""
        with self._path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()


def write(
    sequence: Sequence, path: Path, progress: Progress | None = None, layout: Layout = SLAMBENCH_2
) -> None:
    """Write any sequence: depth, colour if the first frame has any, and truth before all frames.

    Intrinsics and poses are kept as 32-bit floats. The file appears when whole. Raises SequenceError when a
    frame has no colour though the first has, or a stamp does not fit 32 bits of seconds.
    """
    first, last = sequence.timestamps.min(), sequence.timestamps.max()
    if not (first >= 0 and last < 2**32 - 1):
        raise SequenceError(f"stamps from {first} to {last} s: a .slam file holds 0 to {2**32 - 1} s")
    coloured = sequence.colour(0) is not None
    kinds = ["Depth"] + ["Camera"] * coloured + ["GroundTruthTrajectory"] * (sequence.truth is not None)
    with whole_file(path) as file:
        file.write(MAGIC + struct.pack("<II", VERSION, len(kinds)))
        for number, kind in enumerate(kinds):
            file.write(pack_sensor(kind, number, sequence.camera, layout))
        if sequence.truth is not None:
            for seconds, pose in zip(sequence.timestamps, sequence.truth, strict=True):
                if np.isfinite(pose).all():
                    _write_frame(file, float(seconds), len(kinds) - 1, pose.T.astype("<f4").tobytes())
        for index, seconds in enumerate(sequence.timestamps):
            _write_frame(file, float(seconds), 0, sequence.depth(index).astype("<u2").tobytes())
            if coloured:
                colour = sequence.colour(index)
                if colour is None:
                    raise SequenceError(f"frame {index} of {sequence.name!r} has no colour, frame 0 has")
                _write_frame(file, float(seconds), 1, colour.tobytes())
            if progress:
                progress(index + 1, len(sequence))


def _write_frame(file: BinaryIO, seconds: float, sensor: int, payload: bytes) -> None:
    nanoseconds = round(seconds * 1e9)
    file.write(struct.pack("<IIB", *divmod(nanoseconds, 10**9), sensor) + payload)


def _read_index(path: Path) -> tuple[list[Sensor], list[_Frame]]:
    """The sensors and where the frames lie, by the layout that reaches the end of the file, or furthest."""
    total = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(_HEADER)
        if not header.startswith(MAGIC) or len(header) < 13:
            raise SequenceError(f"{path} is not a .slam file: it does not begin with {MAGIC!r} and a version")
        version, count = struct.unpack_from("<II", header, len(MAGIC))
        if version != VERSION:
            raise SequenceError(f"{path} has the version {version}: only version {VERSION} can be read")
        best: tuple[list[Sensor], list[_Frame], int] | None = None
        reasons = []
        for layout in LAYOUTS:
            try:
                sensors, begin = parse_sensors(header, len(MAGIC) + 8, count, layout)
            except LayoutError as reason:
                reasons.append(str(reason))
                continue
            frames = list(_frames(file, sensors, begin, total))
            end = frames[-1].offset + frames[-1].size if frames else begin
            if end == total and frames:
                return sensors, frames
            if best is None or end > best[2]:
                best = sensors, frames, end
    if best is None:
        raise SequenceError(f"{path}: the sensors of its header cannot be read: {reasons[0]}")
    sensors, frames, end = best
    raise SequenceError(
        f"{path} is cut short or damaged: {len(frames)} whole frames end at byte {end} of {total}"
    )


def _frames(file: BinaryIO, sensors: list[Sensor], offset: int, total: int) -> Iterator[_Frame]:
    """The frames from byte `offset` on that make sense and are whole."""
    while offset + 9 <= total:
        file.seek(offset)
        head = file.read(13)
        seconds, nanoseconds, number = struct.unpack_from("<IIB", head)
        if number >= len(sensors) or nanoseconds >= 10**9:
            return
        size, begin = sensors[number].frame_bytes, offset + 9
        if size is None:
            if len(head) < 13:
                return
            (size,) = struct.unpack_from("<I", head, 9)
            begin += 4
        offset = begin + size
        if offset > total:
            return
        yield _Frame(seconds + nanoseconds / 1e9, number, begin, size)
