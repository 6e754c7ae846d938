import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.camera import Camera
from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats import icl_nuim, images
from slam.trajectories.trajectory import Trajectory
from tests.slam.real import DATA, needs_real_data
from tests.slam.sequences import ArraySequence, random_poses

pytest.importorskip("cv2", reason="image folders need OpenCV")


def sequence(seed=0, frames=3, truth=True):
    rng = np.random.default_rng(seed)
    depth = rng.integers(0, 13000, (frames, 6, 8))
    colour = rng.integers(0, 256, (frames, 6, 8, 3)).astype(np.uint8)
    return ArraySequence(depth, colour, random_poses(frames, rng) if truth else None)


def same(again, source):
    assert len(again) == len(source)
    assert again.camera == source.camera
    np.testing.assert_allclose(again.timestamps, source.timestamps, atol=1e-6)
    for index in range(len(source)):
        np.testing.assert_array_equal(again.depth(index), source.depth(index))
        np.testing.assert_array_equal(again.colour(index), source.colour(index))


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_the_png_form_survives(tmp_path_factory, seed):
    source = sequence(seed)
    folder = tmp_path_factory.mktemp("icl") / "room"
    icl_nuim.write(source, folder)
    again = open_sequence(folder)
    same(again, source)
    np.testing.assert_allclose(again.truth, source.truth, atol=1e-7)


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_the_original_form_survives(tmp_path_factory, seed):
    source = sequence(seed)
    folder = tmp_path_factory.mktemp("icl") / "room"
    icl_nuim.write_original(source, folder)
    again = open_sequence(folder, source.camera)
    same(again, source)
    np.testing.assert_allclose(again.truth, source.truth, atol=1e-8)


def test_depth_that_5000_units_a_metre_cannot_hold_is_not_measured(tmp_path):
    icl_nuim.write(ArraySequence([[[13106, 13107, 13108]]], truth=np.eye(4)[None]), tmp_path / "room")
    assert open_sequence(tmp_path / "room").depth(0).tolist() == [[13106, 0, 0]]


def test_without_truth_the_png_form_is_a_tum_folder(tmp_path):
    source = sequence(truth=False)
    icl_nuim.write(source, tmp_path / "room")
    again = open_sequence(tmp_path / "room")
    same(again, source)
    assert again.truth is None


def test_distances_along_the_ray_become_depth_along_the_axis(tmp_path):
    """A wall two metres ahead of ICL-NUIM's camera: its corner is farther away than its middle."""
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    distances = 2 * np.sqrt(((u - 319.5) / 481.2) ** 2 + ((v - 239.5) / -480.0) ** 2 + 1)
    (tmp_path / "scene_00_0000.depth").write_text(" ".join(f"{d:.6g}" for d in distances.ravel()))
    opened = open_sequence(tmp_path)
    assert opened.camera == Camera(481.2, 480, 319.5, 239.5, 640, 480)
    assert opened.truth is None
    assert opened.colour(0) is None
    np.testing.assert_array_equal(opened.depth(0), 2000)


def test_the_camera_of_povray_becomes_a_pose(tmp_path):
    (tmp_path / "scene_00_0007.depth").write_text("1")
    (tmp_path / "scene_00_0007.txt").write_text(
        "cam_pos      = [1, 2, 3]';\n"
        "cam_dir      = [0, 0, -2]';\n"
        "cam_up       = [0, 1, 0]';\n"
        "cam_lookat   = [0, 0, 1]';\n"
        "cam_sky      = [0, 1, 0]';\n"
        "cam_right    = [-1.33333, 0, 0]';\n"
        "cam_fpoint   = [0, 0, 10]';\n"
        "cam_angle    = 90;\n"
    )
    opened = open_sequence(tmp_path, Camera(1, 1, 0, 0, 1, 1))
    assert opened.timestamps.tolist() == [7 / 30]
    expected = [[-1, 0, 0, 1], [0, 1, 0, -2], [0, 0, -1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(opened.truth[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "size"), [("living_room_traj2_loop", 4.8), ("icl-kt2-original", 4.8), ("bucket2", None)]
)
def test_known_trajectories_have_slambenchs_volume(tmp_path, name, size):
    (tmp_path / name).mkdir()
    (tmp_path / name / "scene_00_0000.depth").write_text("1")
    assert open_sequence(tmp_path / name).volume_size == size


def test_known_trajectories_have_slambenchs_start(tmp_path):
    source = sequence()
    icl_nuim.write(source, tmp_path / "livingRoom1")
    again = open_sequence(tmp_path / "livingRoom1")
    assert (again.volume_size, again.initial_position) == (5.0, (0.485, 0.5, 0.55))


def test_a_camera_with_negative_fy_is_turned_upright_with_its_poses(tmp_path):
    source = sequence()
    icl_nuim.write(source, tmp_path / "room")
    c = source.camera
    (tmp_path / "room/intrinsics.txt").write_text(f"{c.fx} {-c.fy} {c.cx} {c.cy} 8 6 5000")
    again = open_sequence(tmp_path / "room")
    assert again.camera == c
    np.testing.assert_allclose(again.truth, source.truth, atol=1e-7)


def test_a_pose_file_of_icl_nuim_is_mirrored_for_other_forms_too(tmp_path):
    icl_nuim.write(sequence(), tmp_path / "room")
    (tmp_path / "plain/depth").mkdir(parents=True)
    for number in range(3):
        shutil.copy(tmp_path / f"room/depth/{number}.png", tmp_path / "plain/depth")
    (tmp_path / "plain/intrinsics.txt").write_text("6.4 4.86 3.5 2.5 8 6 5000")
    truth = open_sequence(tmp_path / "plain", truth=tmp_path / "room/room.gt.freiburg").truth
    np.testing.assert_allclose(truth, sequence().truth, atol=1e-7)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("scene_00_0000.depth", "1 2 3", "holds 3 distances, an image of 640x480 has 307200"),
        ("scene_00_0000.depth", "1 2 x", "cannot be read as distances"),
        ("scene_00_end.depth", "1", "name frames scene_00_0000.depth"),
    ],
)
def test_depth_that_is_none_says_so(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(SequenceError, match=message):
        open_sequence(tmp_path).depth(0)


@pytest.mark.parametrize(
    "text",
    [
        "hello",
        "cam_pos = [0, 0, 0]';\ncam_dir = [0, 0, 1]';\ncam_up = [0, 1]';\n",
        "cam_pos = [0, 0, 0]';\ncam_dir = [0, 0, 1]';\ncam_up = [0, 0, 2]';\n",
    ],
)
def test_a_camera_file_that_is_none_is_named(tmp_path, text):
    (tmp_path / "scene_00_0000.depth").write_text("1")
    (tmp_path / "scene_00_0000.txt").write_text(text)
    with pytest.raises(SequenceError, match=r"scene_00_0000\.txt"):
        open_sequence(tmp_path)


@needs_real_data
def test_the_published_pose_file_belongs_to_the_published_images(tmp_path):
    """Frames 1 to 3 of the real living room 2, in the layout of its archive."""
    real = DATA / "rgbd/icl_livingroom2_first4"
    for kind in ("depth", "rgb"):
        shutil.copytree(real / kind, tmp_path / kind)
    shutil.copy(DATA / "trajectories/icl_nuim_livingroom/livingRoom2.gt.freiburg", tmp_path)
    (tmp_path / "associations.txt").write_text(
        "".join(f"{i} depth/{i}.png {i} rgb/{i}.png\n" for i in range(4))
    )
    opened = open_sequence(tmp_path)
    assert opened.volume_size == 4.8
    assert np.isnan(opened.truth[0]).all()
    np.testing.assert_allclose(opened.timestamps, np.arange(4) / 30)
    np.testing.assert_array_equal(opened.colour(3), images.read_colour(real / "rgb/3.png"))
    expected = Trajectory.read(real / "groundtruth.txt").poses
    relative = np.linalg.inv(opened.truth[1]) @ opened.truth[1:]
    np.testing.assert_allclose(relative, np.linalg.inv(expected[1]) @ expected[1:], atol=5e-5)


@pytest.mark.slow
@needs_real_data
def test_real_depth_and_poses_survive_the_original_form(tmp_path):
    source = open_sequence(DATA / "rgbd/icl_livingroom2_first4")
    icl_nuim.write_original(source, tmp_path / "living_room_traj2_loop")
    again = open_sequence(tmp_path / "living_room_traj2_loop")
    assert again.camera == source.camera
    np.testing.assert_array_equal(again.depth(3), source.depth(3))
    np.testing.assert_allclose(again.truth, source.truth, atol=1e-7)
