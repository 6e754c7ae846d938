import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats.slambench import slam_file
from slam.datasets.formats.slambench.sensors import LAYOUTS, SLAMBENCH_2, SLAMBENCH_3, Layout
from slam.trajectories.trajectory import Trajectory
from tests.slam.sequences import ArraySequence, random_poses


def sequence(seed=0, frames=3, coloured=True, truth=True):
    rng = np.random.default_rng(seed)
    depth = rng.integers(0, 65536, (frames, 6, 8))
    colour = rng.integers(0, 256, (frames, 6, 8, 3)).astype(np.uint8) if coloured else None
    return ArraySequence(depth, colour, random_poses(frames, rng) if truth else None)


def texts(name, kind):
    """Name and type as SLAMBench writes them: a length that counts the final NUL."""
    return b"".join(struct.pack("<B", len(text) + 1) + text + b"\0" for text in (name, kind))


def handmade():
    """A file byte by byte as SLAMBench 2 lays it out, with one depth image of 2x1."""
    identity = struct.pack("<16f", *np.eye(4).ravel())
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    return b"".join(
        [
            b"SLAM\0" + struct.pack("<II", 1, 4),
            texts(b"PointCloud", b"PointCloud") + struct.pack("<BI", 0, 3) + b"gt\0",
            struct.pack("<f", 0) + struct.pack("<16f", *[float("nan")] * 16),
            texts(b"Acc", b"Accelerometer") + struct.pack("<BI", 1, 1) + b"\0",
            struct.pack("<f", 1) + identity + bytes(72),
            texts(b"Depth", b"Depth") + struct.pack("<BI", 2, 1) + b"\0",
            struct.pack("<f", 1) + identity + struct.pack("<4I", 1, 5, 2, 1),
            struct.pack("<4f", 0.75, -1.0, 0.5, 0.25) + struct.pack("<2fI", 0.001, 0, 0),
            texts(b"GT", b"GroundTruthTrajectory") + struct.pack("<BI", 3, 1) + b"\0",
            struct.pack("<f", 1) + identity,
            struct.pack("<IIB", 0, 0, 0) + struct.pack("<I", 5) + b"cloud",
            struct.pack("<IIB", 7, 500_000_000, 3) + struct.pack("<16f", *pose.T.ravel()),
            struct.pack("<IIB", 7, 500_000_000, 1) + bytes(12),
            struct.pack("<IIB", 7, 500_000_000, 2) + struct.pack("<HH", 1000, 2000),
        ]
    )


@given(st.integers(0, 1000), st.sampled_from(LAYOUTS), st.booleans(), st.booleans())
@settings(max_examples=60)
def test_every_layout_that_slambench_ever_wrote_survives(tmp_path_factory, seed, layout, coloured, truth):
    source = sequence(seed, coloured=coloured, truth=truth)
    path = tmp_path_factory.mktemp("slam") / "room.slam"
    slam_file.write(source, path, layout=layout)
    again = open_sequence(path)
    assert again.name == "room"
    assert len(again) == 3
    np.testing.assert_allclose(again.timestamps, source.timestamps, atol=1e-9)
    for field in ("fx", "fy", "cx", "cy", "width", "height"):
        assert getattr(again.camera, field) == pytest.approx(getattr(source.camera, field), rel=1e-6)
    for index in range(3):
        np.testing.assert_array_equal(again.depth(index), source.depth(index))
        if coloured:
            np.testing.assert_array_equal(again.colour(index), source.colour(index))
        else:
            assert again.colour(index) is None
    if truth:
        np.testing.assert_allclose(again.truth, source.truth, atol=1e-6)
    else:
        assert again.truth is None


def test_a_file_made_by_hand_is_read(tmp_path):
    path = tmp_path / "hand.slam"
    path.write_bytes(handmade())
    opened = open_sequence(path)
    assert opened.depth(0).tolist() == [[1000, 2000]]
    assert opened.timestamps.tolist() == [7.5]
    assert (opened.camera.fx, opened.camera.fy, opened.camera.cx, opened.camera.cy) == (1.5, -1, 1, 0.25)
    assert opened.truth[0, :3, 3].tolist() == [1, 2, 3]
    assert opened.colour(0) is None


def test_the_written_layout_is_slambenchs(tmp_path):
    path = tmp_path / "room.slam"
    source = ArraySequence([[[1, 258]]])
    slam_file.write(source, path)
    c = source.camera
    expected = b"".join(
        [
            b"SLAM\0" + struct.pack("<II", 1, 1),
            texts(b"Depth", b"Depth") + struct.pack("<BI", 0, 6) + b"Depth\0",
            struct.pack("<f16f", 30, *np.eye(4).ravel()) + struct.pack("<4I", 1, 5, 2, 1),
            struct.pack("<4f", c.fx / 2, c.fy, c.cx / 2, c.cy),
            struct.pack("<2fI", 0.001, 0, 0) + struct.pack("<I5f", 0, 0, 0, 0, 0, 0),
            struct.pack("<IIBHH", 0, 0, 0, 1, 258),
        ]
    )
    assert path.read_bytes() == expected


def test_the_newest_slambench_has_a_delay_and_three_distortions(tmp_path):
    old, new = tmp_path / "old.slam", tmp_path / "new.slam"
    slam_file.write(sequence(), old, layout=SLAMBENCH_2)
    slam_file.write(sequence(), new, layout=SLAMBENCH_3)
    assert new.stat().st_size - old.stat().st_size == 3 * 4 + 2 * 20


def test_disparity_parameters_turn_into_millimetres(tmp_path):
    data = handmade().replace(struct.pack("<2fI", 0.001, 0, 0), struct.pack("<2fI", 0.0002, 0.1, 0))
    (tmp_path / "a.slam").write_bytes(data)
    assert open_sequence(tmp_path / "a.slam").depth(0).tolist() == [[300, 500]]


def test_given_intrinsics_and_truth_go_before_the_files_own(tmp_path):
    slam_file.write(sequence(), tmp_path / "a.slam")
    poses = random_poses(3, np.random.default_rng(9))
    Trajectory(np.arange(3) / 30, poses).write(tmp_path / "truth.txt")
    opened = open_sequence(tmp_path / "a.slam", (9, 8, 4, 3), tmp_path / "truth.txt")
    assert opened.camera.fx == 9
    np.testing.assert_allclose(opened.truth, poses, atol=1e-7)


def test_truth_of_a_body_that_is_not_the_camera_is_refused(tmp_path):
    data = bytearray(handmade())
    place = data.index(b"Depth\0\x06Depth\0") + 13 + 1 + 4 + 1 + 4
    assert struct.unpack_from("<f", data, place) == (1.0,)
    struct.pack_into("<f", data, place + 48, 0.25)
    (tmp_path / "a.slam").write_bytes(data)
    with pytest.raises(SequenceError, match="mounted elsewhere"):
        open_sequence(tmp_path / "a.slam")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is not a .slam file"),
        (b"KLAM\0" + bytes(8), "is not a .slam file"),
        (b"SLAM\0" + struct.pack("<II", 2, 0), "has the version 2"),
        (b"SLAM\0" + struct.pack("<II", 1, 1) + b"\xff", "cannot be read"),
        (
            b"SLAM\0" + struct.pack("<II", 1, 1) + texts(b"x", b"Lidar") + bytes(5) + bytes(80),
            "'Lidar' are not known|cannot be read",
        ),
        (handmade()[:-1], "cut short or damaged: 3 whole frames"),
        (handmade() + b"\0", "cut short or damaged: 4 whole frames"),
        (handmade().replace(struct.pack("<4I", 1, 5, 2, 1), struct.pack("<4I", 3, 5, 2, 1)), "only raster"),
        (handmade()[: -13 - 21 - 9 - 64], "holds no depth frame|cut short"),
    ],
)
def test_a_file_that_cannot_be_used_says_why_in_one_line(tmp_path, data, message):
    (tmp_path / "bad.slam").write_bytes(data)
    with pytest.raises(SequenceError, match=message) as error:
        open_sequence(tmp_path / "bad.slam")
    assert "\n" not in str(error.value)


@given(st.data())
@settings(max_examples=60)
def test_a_damaged_file_is_refused_or_read_but_never_breaks_the_reader(tmp_path_factory, data):
    good = bytearray(handmade())
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("slam") / "bad.slam"
    path.write_bytes(good)
    try:
        opened = open_sequence(path)
        opened.depth(len(opened) - 1)
    except ValueError:  # SequenceError and TrajectoryError
        pass


def test_colour_that_ends_midway_is_refused(tmp_path):
    source = sequence()
    colour = source._colour
    source.colour = lambda index: colour[index] if index < 2 else None
    with pytest.raises(SequenceError, match="frame 2 of 'arrays' has no colour"):
        slam_file.write(source, tmp_path / "a.slam")
    assert not (tmp_path / "a.slam").exists()


@pytest.mark.parametrize("stamp", [-1.0, 2.0**32, float("nan")])
def test_stamps_that_do_not_fit_are_refused(tmp_path, stamp):
    source = sequence()
    source.timestamps = np.array([0.0, stamp, 1.0])
    with pytest.raises(SequenceError, match=r"a \.slam file holds"):
        slam_file.write(source, tmp_path / "a.slam")


def test_layouts_differ_in_their_fields():
    assert len(set(LAYOUTS)) == len(LAYOUTS) == 18
    assert Layout() == SLAMBENCH_2
