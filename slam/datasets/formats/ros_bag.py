"""Bags of ROS 1 (`.bag`) and ROS 2 (a folder, `.db3` or `.mcap`), through the package rosbags.

Depth is a topic of uncompressed images: 16 bits in millimetres, or floating-point numbers in metres, as REP
118 says. The camera is that of the `camera_info` topic with the most similar name. Stamps are those of the
images' headers. True poses are not looked for in a bag.
"""

from __future__ import annotations

import hashlib
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from posixpath import commonpath
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.datasets.formats.images import MissingDependencyError
from slam.datasets.formats.units import METRES, MILLIMETRES, check_units, to_millimetres
from slam.datasets.sequence import (
    Given,
    Sequence,
    SequenceError,
    check_camera,
    file_sha256,
    make_camera,
    read_truth,
)
from slam.trajectories.trajectory import associate

SUFFIXES = (".bag", ".db3", ".mcap")
IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
DEPTH_TYPES = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
COLOUR_CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
COLOUR_DIFFERENCE = 0.02  # seconds between a depth image and its colour


def is_ros_bag(path: Path) -> bool:
    return (path / "metadata.yaml").exists() if path.is_dir() else path.suffix in SUFFIXES


class RosBag(Sequence):
    """The depth images of one topic, and those of a colour topic of the same size."""

    def __init__(
        self, path: Path, camera: Given = None, truth: Path | None = None, units: float | None = None
    ) -> None:
        self.name = path.resolve().stem
        self._path = path
        self._reader = _open_reader(path)
        weakref.finalize(self, self._reader.close)
        with self._reported():
            depth, colour = self._image_topics()
            self._depth, self.timestamps = self._index(depth)
            height, width = self._image(self._depth[0]).shape[:2]
            self._colour = self._matched_colour(colour, (height, width))
            if camera is None:
                camera = self._camera_numbers(depth.topic)
        if isinstance(camera, tuple):
            camera = make_camera(camera, (width, height), path)
        self.camera = camera
        check_camera(self.camera, path)
        self._units = None if units is None else check_units(units, path)
        if truth is not None:
            self.truth = read_truth(truth, self.camera, self.timestamps)

    @contextmanager
    def _reported(self) -> Iterator[None]:
        """Turn whatever a damaged bag makes the package raise into a SequenceError."""
        try:
            yield
        except SequenceError:
            raise
        except Exception as error:
            raise SequenceError(f"{self._path} cannot be read as a bag of ROS: {error}") from None

    def _image_topics(self) -> tuple[Any, list[Any]]:
        """The connection of the depth topic, and those of colour topics."""
        kinds: dict[str, list[Any]] = {"depth": [], "colour": []}
        for connection in self._reader.connections:
            first = next(self._reader.messages([connection]), None) if connection.msgtype == IMAGE else None
            if first is not None:
                encoding = self._reader.deserialize(first[2], IMAGE).encoding
                kind = "depth" if encoding in DEPTH_TYPES else "colour" if encoding in COLOUR_CHANNELS else ""
                kinds.get(kind, []).append(connection)
        if not kinds["depth"]:
            topics = ", ".join(sorted({connection.topic for connection in self._reader.connections}))
            raise SequenceError(
                f"{self._path} has no uncompressed depth images ({', '.join(DEPTH_TYPES)}) in its topics "
                f"{topics}: record them uncompressed"
            )
        # Depth that is aligned to colour goes first; 16 bits may also be infrared, which is not called depth.
        named = sorted(
            kinds["depth"], key=lambda c: ("depth" not in c.topic.lower(), "aligned" not in c.topic, c.topic)
        )
        return named[0], sorted(kinds["colour"], key=lambda c: c.topic)

    def _index(self, connection: Any) -> tuple[list[tuple[Any, int]], npt.NDArray[np.float64]]:
        """Where the images of a topic lie, as connection and recording time, in the order of their stamps."""
        stamped = []
        for _, recorded, data in self._reader.messages([connection]):
            stamp = self._reader.deserialize(data, IMAGE).header.stamp
            seconds = stamp.sec + stamp.nanosec / 1e9
            stamped.append((seconds or recorded / 1e9, recorded))  # 0: the camera's driver sets no stamp
        stamped.sort()
        return [(connection, recorded) for _, recorded in stamped], np.array(
            [seconds for seconds, _ in stamped]
        )

    def _matched_colour(self, topics: list[Any], size: tuple[int, int]) -> dict[int, tuple[Any, int]]:
        """The colour image of each frame, from the first topic whose images have the size of the depth."""
        for connection in topics:
            entries, stamps = self._index(connection)
            if self._image(entries[0]).shape[:2] == size:
                frames, rows = associate(self.timestamps, stamps, COLOUR_DIFFERENCE)
                return {int(frame): entries[row] for frame, row in zip(frames, rows, strict=True)}
        return {}

    def _camera_numbers(self, topic: str) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy of the camera whose topic shares the longest beginning with `topic`."""
        cameras = [connection for connection in self._reader.connections if connection.msgtype == CAMERA_INFO]
        for camera in sorted(cameras, key=lambda c: -len(commonpath([f"/{c.topic}", f"/{topic}"]))):
            for _, _, data in self._reader.messages([camera]):
                message = self._reader.deserialize(data, CAMERA_INFO)
                matrix = message.k if hasattr(message, "k") else message.K
                return float(matrix[0]), float(matrix[4]), float(matrix[2]), float(matrix[5])
        raise SequenceError(f"{self._path} has no camera_info for {topic}: give the camera as fx,fy,cx,cy")

    def _image(self, entry: tuple[Any, int]) -> npt.NDArray[Any]:
        """The pixels of the image at `entry`: (height, width) for depth, (height, width, 3) for colour."""
        connection, recorded = entry
        _, _, data = next(self._reader.messages([connection], start=recorded, stop=recorded + 1))
        message = self._reader.deserialize(data, IMAGE)
        rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
        if message.encoding in DEPTH_TYPES:
            kind = np.dtype((">" if message.is_bigendian else "<") + DEPTH_TYPES[message.encoding])
            pixels = np.ascontiguousarray(rows[:, : message.width * kind.itemsize]).view(kind)
            return pixels.astype(kind.newbyteorder("="), copy=False)
        channels = COLOUR_CHANNELS[message.encoding]
        count = message.encoding.count("a") + 3  # rgba8 and bgra8 have a fourth
        pixels = rows[:, : message.width * count].reshape(message.height, message.width, count)
        return np.ascontiguousarray(pixels[..., channels])

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        with self._reported():
            image = self._image(self._depth[index])
        self._check_size(image, index)
        usual = METRES if image.dtype.kind == "f" else MILLIMETRES
        return to_millimetres(image, self._units or usual)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        if index not in self._colour:
            return None
        with self._reported():
            image = self._image(self._colour[index])
        self._check_size(image, index)
        return image

    def _check_size(self, image: npt.NDArray[Any], index: int) -> None:
        height, width = image.shape[:2]
        if (height, width) != (self.camera.height, self.camera.width):
            raise SequenceError(
                f"{self._path}: an image of frame {index} is {width}x{height}, the camera says "
                f"{self.camera.width}x{self.camera.height}"
            )

    @cached_property
    def sha256(self) -> str:
        """Over the camera, the depth unit, the topic and the files of the bag."""
        topic = self._depth[0][0].topic
        digest = hashlib.sha256(f"{self.camera} {self._units} {topic}\n".encode())
        files = sorted(self._path.iterdir()) if self._path.is_dir() else [self._path]
        for path in files:
            if path.suffix in SUFFIXES:
                digest.update(bytes.fromhex(file_sha256(path)))
        return digest.hexdigest()


def _open_reader(path: Path) -> Any:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingDependencyError(
            "bags of ROS need rosbags, which is not installed here: pip install 'frontrunner[rosbags]'"
        ) from None
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:  # the package raises many kinds for damaged files
        raise SequenceError(f"{path} cannot be read as a bag of ROS: {error}") from None
    return reader
