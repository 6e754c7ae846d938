"""Folders of images as recorders and data sets write them: units, floating-point depth, Open3D, 7-Scenes."""

import json
import sys

import numpy as np
import pytest

from slam.__main__ import main
from slam.camera import Camera
from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats import images
from slam.trajectories.trajectory import Trajectory
from tests.slam.sequences import random_poses
from tests.slam.tiny import write_tiny_pack

cv2 = pytest.importorskip("cv2", reason="image folders need OpenCV")

DEPTH = np.arange(1500, 1548, dtype=np.uint16).reshape(6, 8)
COLOUR = np.arange(144, dtype=np.uint8).reshape(6, 8, 3)
CAMERA = Camera(8.0, 9.0, 3.5, 2.5, 8, 6)
FOUR = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)


def folder(path, colour="color"):
    for kind in ("depth", colour):
        (path / kind).mkdir(parents=True)
    for frame in range(2):
        images.write_depth(path / "depth" / f"{frame:06d}.png", DEPTH + frame)
        images.write_colour(path / colour / f"{frame:06d}.png", COLOUR)
    return path


def test_units_decide_where_no_file_says_them(tmp_path):
    path = folder(tmp_path)
    sequence = open_sequence(path, FOUR, units=1000)
    np.testing.assert_array_equal(sequence.depth(1), DEPTH + 1)
    assert sequence.assumed_units is None
    assumed = open_sequence(path, FOUR)
    assert assumed.depth(0)[0, 0] == 300
    assert assumed.assumed_units == 5000
    assert assumed.sha256 != sequence.sha256


@pytest.mark.parametrize("units", [0, -1000, 1e7])
def test_units_that_no_camera_writes_are_refused(tmp_path, units):
    with pytest.raises(SequenceError, match="depth units a metre: must be above 0"):
        open_sequence(folder(tmp_path), FOUR, units=units)


def test_info_warns_of_millimetres_that_are_read_in_another_unit_and_units_silence_it(tmp_path, capsys):
    path = folder(tmp_path / "room")
    assert main(["datasets", "info", str(path), "--camera", "8,9,3.5,2.5"]) == 0
    captured = capsys.readouterr()
    assert "warning: room: the median depth is 0.30 m" in captured.err
    assert "5000 units per metre were assumed: give --units" in captured.err
    assert main(["datasets", "info", str(path), "--camera", "8,9,3.5,2.5", "--units", "1000"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "median 1.52 m" in captured.out


def test_a_pack_says_its_units_itself(tmp_path):
    with pytest.raises(SequenceError, match="omit them"):
        open_sequence(write_tiny_pack(tmp_path), units=1000)


@pytest.mark.parametrize(("name", "scale"), [("intrinsic.json", 1000), ("camera_intrinsic.json", None)])
def test_folders_of_open3d_are_read_with_camera_units_and_colour(tmp_path, name, scale):
    path = folder(tmp_path)
    described = {"width": 8, "height": 6, "intrinsic_matrix": [8, 0, 0, 0, 9, 0, 3.5, 2.5, 1]}
    (path / name).write_text(json.dumps(described | ({"depth_scale": scale} if scale else {})))
    sequence = open_sequence(path)
    assert sequence.camera == CAMERA
    np.testing.assert_array_equal(sequence.depth(0), DEPTH)
    np.testing.assert_array_equal(sequence.colour(1), COLOUR)


@pytest.mark.parametrize(
    "text",
    ["{", "[]", "{}", '{"width": 8, "height": 6, "intrinsic_matrix": [8, 9, 3.5]}',
     '{"width": 8.5, "height": 6, "intrinsic_matrix": [8, 0, 0, 0, 9, 0, 3.5, 2.5, 1]}'],
)  # fmt: skip
def test_a_camera_file_of_open3d_that_is_wrong_is_refused(tmp_path, text):
    path = folder(tmp_path)
    (path / "intrinsic.json").write_text(text)
    with pytest.raises(SequenceError, match=r"intrinsic\.json is not a camera of Open3D"):
        open_sequence(path)


def test_floating_point_depth_is_in_metres_unless_units_are_given(tmp_path):
    (tmp_path / "depth").mkdir()
    metres = DEPTH.astype(np.float32) / 1000
    metres[0, :4] = np.nan, np.inf, -1, 0
    cv2.imwrite(str(tmp_path / "depth" / "0.tiff"), metres)
    expected = DEPTH.copy()
    expected[0, :4] = 0
    np.testing.assert_array_equal(open_sequence(tmp_path, FOUR).depth(0), expected)
    np.testing.assert_array_equal(open_sequence(tmp_path, FOUR, units=10).depth(0), np.rint(expected / 10))
    sequence = open_sequence(tmp_path, FOUR)
    assert (sequence.camera, sequence.assumed_units) == (CAMERA, 1)


def test_exr_is_read_where_opencv_can_and_the_error_says_otherwise_what_to_do(tmp_path):
    (tmp_path / "depth").mkdir()
    path = tmp_path / "depth" / "0.exr"
    try:
        written = cv2.imwrite(str(path), DEPTH.astype(np.float32) / 1000)
    except cv2.error:
        written = False
    if written:
        np.testing.assert_array_equal(open_sequence(tmp_path, FOUR).depth(0), DEPTH)
        return
    path.write_bytes(b"v/1\x01 not decoded here")
    with pytest.raises(SequenceError, match="cannot read this EXR file here: convert it to TIFF"):
        open_sequence(tmp_path, FOUR)


def seven_scenes(path, poses):
    path.mkdir()
    for frame, pose in enumerate(poses):
        stem = path / f"frame-{frame:06d}"
        images.write_depth(
            stem.with_suffix(".depth.png"), np.where(DEPTH == 1500, 65535, DEPTH).astype(np.uint16)
        )
        images.write_colour(stem.with_suffix(".color.png"), COLOUR)
        np.savetxt(stem.with_suffix(".pose.txt"), pose)
    return path


def test_a_folder_of_7_scenes_is_read_with_its_poses(tmp_path):
    poses = random_poses(3, np.random.default_rng(0))
    poses[1] = np.nan
    path = seven_scenes(tmp_path / "seq-01", poses)
    sequence = open_sequence(path, FOUR)
    np.testing.assert_allclose(sequence.truth, poses, atol=1e-12)
    np.testing.assert_allclose(sequence.timestamps, [0, 1 / 30, 2 / 30])
    assert sequence.depth(0)[0, :2].tolist() == [0, 1501]
    np.testing.assert_array_equal(sequence.colour(2), COLOUR)
    with pytest.raises(SequenceError, match="8x6, the camera says 640x480"):
        open_sequence(path)


def test_a_pose_of_7_scenes_that_is_not_a_matrix_is_named(tmp_path):
    path = seven_scenes(tmp_path / "seq-01", np.tile(np.eye(4), (2, 1, 1)))
    (path / "frame-000001.pose.txt").write_text("1 0 0 0")
    with pytest.raises(SequenceError, match=r"frame-000001\.pose\.txt is not a pose of 7-Scenes"):
        open_sequence(path, FOUR)


@pytest.mark.parametrize(("name", "tool"), [("a.klg", "convert_klg"), ("a.sens", "SensReader")])
def test_files_that_are_not_read_say_how_to_convert_them(tmp_path, name, tool):
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(SequenceError, match=f"{tool}.*--units 1000"):
        open_sequence(tmp_path / name)


def test_the_axes_of_a_truth_follow_its_name_or_the_option(tmp_path):
    path = folder(tmp_path / "room")
    poses = random_poses(2, np.random.default_rng(1))
    Trajectory(np.arange(2) / 30, poses).write(tmp_path / "truth.freiburg")
    Trajectory(np.arange(2) / 30, poses).write(tmp_path / "truth.txt")
    heights = {
        (name, axes): open_sequence(path, FOUR, tmp_path / name, 1000, axes).truth[1, 1, 3] / poses[1, 1, 3]
        for name in ("truth.txt", "truth.freiburg")
        for axes in (None, "opencv", "y-up")
    }
    assert [round(sign) for sign in heights.values()] == [1, 1, -1, -1, 1, -1]


def test_a_bag_of_ros_without_its_package_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    for name in ("rosbags", "rosbags.highlevel"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(SequenceError, match=r"pip install 'frontrunner\[rosbags\]'"):
        open_sequence(tmp_path / "a.bag")
