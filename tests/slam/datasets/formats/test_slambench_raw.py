import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats.slambench import raw_file
from slam.trajectories.trajectory import Trajectory
from tests.slam.sequences import ArraySequence, random_poses

INTRINSICS = (481.2, 480.0, 319.5, 239.5)


@pytest.mark.slow
@given(st.data())
def test_depth_and_colour_survive(tmp_path_factory, data):
    depth = data.draw(hnp.arrays(np.uint16, hnp.array_shapes(min_dims=3, max_dims=3, max_side=6)))
    colour = data.draw(hnp.arrays(np.uint8, (*depth.shape, 3)))
    path = tmp_path_factory.mktemp("raw") / "scene.raw"
    raw_file.write(ArraySequence(depth, colour), path)
    again = open_sequence(path, INTRINSICS)
    assert len(again) == len(depth)
    assert (again.camera.width, again.camera.height) == depth.shape[:0:-1]
    for index in range(len(depth)):
        np.testing.assert_array_equal(again.depth(index), depth[index])
        np.testing.assert_array_equal(again.colour(index), colour[index])


def test_the_layout_is_slambenchs(tmp_path):
    path = tmp_path / "scene.raw"
    raw_file.write(ArraySequence([[[1, 258]]], np.array([[[[1, 2, 3], [4, 5, 6]]]], np.uint8)), path)
    assert path.read_bytes() == struct.pack("<IIHHII6B", 2, 1, 1, 258, 2, 1, 1, 2, 3, 4, 5, 6)


def test_truth_may_be_given_by_frame_number(tmp_path):
    raw_file.write(ArraySequence(np.ones((5, 2, 3))), tmp_path / "scene.raw")
    poses = random_poses(3, np.random.default_rng(0))
    Trajectory(np.array([1.0, 2.0, 3.0]), poses).write(tmp_path / "truth.txt")
    truth = open_sequence(tmp_path / "scene.raw", INTRINSICS, tmp_path / "truth.txt").truth
    assert np.isnan(truth[[0, 4]]).all()
    np.testing.assert_allclose(truth[1:4], poses, atol=1e-8)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (struct.pack("<II", 0, 7), "0x7"),
        (struct.pack("<II", 2, 2) + bytes(17), "not a whole number of 2x2 frames"),
    ],
)
def test_a_file_that_is_no_raw_says_so(tmp_path, data, message):
    path = tmp_path / "bad.raw"
    path.write_bytes(data)
    with pytest.raises(SequenceError, match=message):
        open_sequence(path, INTRINSICS)


def test_a_damaged_frame_is_named(tmp_path):
    path = tmp_path / "scene.raw"
    raw_file.write(ArraySequence(np.ones((2, 2, 2))), path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] = 9
    path.write_bytes(data)
    with pytest.raises(SequenceError, match="frame 1: the size 9x2"):
        open_sequence(path, INTRINSICS).depth(1)


def test_without_intrinsics_the_message_says_what_to_give(tmp_path):
    raw_file.write(ArraySequence(np.ones((2, 2, 2))), tmp_path / "scene.raw")
    with pytest.raises(SequenceError, match="fx,fy,cx,cy"):
        open_sequence(tmp_path / "scene.raw")
