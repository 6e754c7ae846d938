"""Bags of ROS, as its recorders write them."""

from dataclasses import fields

import numpy as np
import pytest

from slam.camera import Camera
from slam.datasets import SequenceError, open_sequence
from slam.trajectories.trajectory import Trajectory
from tests.slam.sequences import random_poses

pytest.importorskip("rosbags", reason="bags of ROS need the package rosbags")

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

CAMERA = Camera(8.0, 9.0, 3.5, 2.5, 8, 6)
MILLIMETRES = np.arange(1500, 1548, dtype=np.uint16).reshape(6, 8)
METRES = MILLIMETRES.astype(np.float32) / 1000
COLOUR = np.arange(144, dtype=np.uint8).reshape(6, 8, 3)
BEGAN = 1_403_636_579_763_555_584  # nanoseconds


class Recorder:
    """Writes messages of three frames, 0.1 s apart, to a bag of `ros` 1 or 2."""

    def __init__(self, path, ros, plugin="SQLITE3"):
        self.ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        if ros == 1:
            self.writer = rosbag1.Writer(path)
        else:
            self.writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin])

    def message(self, name, **values):
        kind = self.store.types[name]
        if name.endswith("Header") and self.ros == 1:
            values["seq"] = 0
        return kind(**{field.name: values[field.name] for field in fields(kind) if field.name in values})

    def header(self, nanoseconds):
        stamp = self.message(
            "builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
        )
        return self.message("std_msgs/msg/Header", stamp=stamp, frame_id="camera")

    def image(self, nanoseconds, pixels, encoding, padding=0, big=False):
        rows = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).view(np.uint8).reshape(6, -1)
        data = np.pad(rows, ((0, 0), (0, padding)))
        return self.message(
            "sensor_msgs/msg/Image", header=self.header(nanoseconds), height=6, width=8, encoding=encoding,
            is_bigendian=int(big), step=data.shape[1], data=data.ravel(),
        )  # fmt: skip

    def camera_info(self, nanoseconds, camera):
        matrix = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1.0])
        values = {"d": np.zeros(5), "k": matrix, "r": np.eye(3).ravel(), "p": np.zeros(12)}
        if self.ros == 1:
            values = {name.upper(): value for name, value in values.items()}
        region = self.message(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.message(
            "sensor_msgs/msg/CameraInfo", header=self.header(nanoseconds), height=6, width=8,
            distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=region, **values,
        )  # fmt: skip

    def record(self, topics):
        """`topics` map a name to the message of (frame, nanoseconds)."""
        serialize = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        with self.writer as writer:
            for topic, make in topics.items():
                kind = make(0, BEGAN).__msgtype__
                connection = writer.add_connection(topic, kind, typestore=self.store)
                for frame in range(3):
                    nanoseconds = BEGAN + frame * 10**8
                    # The recorder receives a message later than the camera took the image.
                    message = make(frame, nanoseconds)
                    writer.write(connection, nanoseconds + 5 * 10**7, serialize(message, kind))


def record(path, ros=1, plugin="SQLITE3", depth=MILLIMETRES, encoding="16UC1", camera=CAMERA, **image):
    recorder = Recorder(path, ros, plugin)
    other = Camera(99.0, 99.0, 3.5, 2.5, 8, 6)
    topics = {
        "/camera/color/camera_info": lambda _, stamp: recorder.camera_info(stamp, other),
        "/camera/color/image_raw": lambda frame, stamp: recorder.image(
            stamp, (COLOUR + frame)[..., ::-1], "bgr8"
        ),
        "/camera/depth/image_raw": lambda frame, stamp: recorder.image(
            stamp, (depth + np.where(depth == 0, 0, frame)).astype(depth.dtype), encoding, **image
        ),
        "/camera/infra/image_raw": lambda _, stamp: recorder.image(stamp, MILLIMETRES, "mono16"),
    }
    if camera:
        topics["/camera/depth/camera_info"] = lambda _, stamp: recorder.camera_info(stamp, camera)
    recorder.record(topics)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("name", "ros", "plugin"), [("a.bag", 1, ""), ("a", 2, "SQLITE3"), ("b", 2, "MCAP")])
def test_bags_of_both_versions_are_read_with_camera_stamps_and_colour(tmp_path, name, ros, plugin):
    sequence = open_sequence(record(tmp_path / name, ros, plugin))
    assert len(sequence) == 3
    assert sequence.camera == CAMERA
    np.testing.assert_allclose(sequence.timestamps, BEGAN / 1e9 + np.arange(3) / 10, atol=1e-6)
    for index in (2, 0, 1):
        np.testing.assert_array_equal(sequence.depth(index), MILLIMETRES + index)
        np.testing.assert_array_equal(sequence.colour(index), COLOUR + index)
    assert len(sequence.sha256) == 64


def test_floating_point_depth_is_in_metres_and_units_replace_millimetres(tmp_path):
    metres = METRES.copy()
    metres[0, :2] = np.nan, 0
    sequence = open_sequence(record(tmp_path / "a.bag", depth=metres, encoding="32FC1"))
    assert sequence.depth(0)[0].tolist() == [0, 0, *range(1502, 1508)]
    assert open_sequence(record(tmp_path / "b.bag"), units=10_000).depth(0)[0, 0] == 150


def test_rows_may_be_padded_and_words_swapped(tmp_path):
    sequence = open_sequence(record(tmp_path / "a.bag", padding=3, big=True))
    np.testing.assert_array_equal(sequence.depth(1), MILLIMETRES + 1)


def test_a_truth_is_matched_by_the_stamps_of_the_headers(tmp_path):
    poses = random_poses(3, np.random.default_rng(0))
    Trajectory(BEGAN / 1e9 + np.arange(3) / 10, poses).write(tmp_path / "truth.txt")
    truth = open_sequence(record(tmp_path / "a.bag"), truth=tmp_path / "truth.txt").truth
    np.testing.assert_allclose(truth, poses, atol=1e-8)


def test_a_bag_without_depth_names_its_topics(tmp_path):
    recorder = Recorder(tmp_path / "a.bag", 1)
    recorder.record({"/color": lambda _, stamp: recorder.image(stamp, COLOUR, "rgb8")})
    with pytest.raises(SequenceError, match=r"no uncompressed depth images .* topics /color: record them"):
        open_sequence(tmp_path / "a.bag")


def test_the_camera_of_another_topic_is_taken_where_depth_has_none_and_a_given_one_goes_first(tmp_path):
    path = record(tmp_path / "a.bag", camera=None)
    assert open_sequence(path).camera.fx == 99
    assert open_sequence(path, (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)).camera == CAMERA


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_bag_that_is_cut_short_is_refused(tmp_path, share):
    path = record(tmp_path / "a.bag")
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(SequenceError, match=r"a\.bag cannot be read as a bag of ROS"):
        open_sequence(path)
