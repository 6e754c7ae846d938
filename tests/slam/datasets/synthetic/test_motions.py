import numpy as np
import pytest

from slam.__main__ import main
from slam.datasets import SequenceError, open_sequence
from slam.datasets.sequence import regular_timestamps
from slam.datasets.synthetic.motions import MOTIONS, with_motion
from slam.datasets.synthetic.scenes import SCENES, with_role

STAMPS = regular_timestamps(100)


@pytest.fixture(params=[*with_role("learned-on"), *with_role("held-out")], ids=lambda scene: scene.name)
def scene(request):
    return request.param


def speeds(poses):
    """Metres a frame and radians a second."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    traces = np.einsum("nij,nij->n", poses[:-1, :3, :3], poses[1:, :3, :3])
    return steps, 30 * np.arccos(np.clip((traces - 1) / 2, -1, 1))


def test_a_fast_rotation_turns_by_1_to_2_radians_a_second_and_hardly_travels(scene):
    steps, turned = speeds(with_motion(scene, "fast-rotation").poses(regular_timestamps(300), 7))
    assert steps.max() < 0.01
    assert 1.0 < turned[10:].mean() < 1.5
    assert 1.7 < np.percentile(turned[10:], 95) < 2.2


def test_a_fast_rotation_is_jerky_and_shows_new_parts_of_the_room(scene):
    poses = with_motion(scene, "fast-rotation").poses(regular_timestamps(300), 7)
    assert np.abs(np.diff(speeds(poses)[1])).max() > 0.5  # between two frames
    gaze = np.degrees(np.arccos(np.clip(poses[:, :3, 2] @ poses[0, :3, 2], -1, 1)))
    assert 45 < gaze.max() < 120


@pytest.mark.slow
def test_a_fast_walk_travels_145_millimetres_a_frame_along_the_scenes_path(scene):
    poses = with_motion(scene, "fast-walk").poses(STAMPS, 7)
    assert 0.13 < speeds(poses)[0][15:].mean() < 0.146
    path = scene.poses(np.arange(0, 60, 1 / 120), 7)[:, :3, 3]
    for position in poses[::9, :3, 3]:
        assert np.linalg.norm(path - position, axis=1).min() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_camera_holds_still_for_four_frames_and_the_seed_decides(scene, motion):
    first, again, other = (with_motion(scene, motion).poses(STAMPS, seed) for seed in (7, 7, 8))
    assert max(speed[:3].max() for speed in speeds(first)) < 1e-6
    np.testing.assert_array_equal(first[0], scene.poses(STAMPS, 7)[0])
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-4


def test_a_loop_keeps_its_path():
    with pytest.raises(SequenceError, match="studio-loop is a loop"):
        with_motion(SCENES["studio-loop"], "fast-walk")


def test_make_writes_a_scene_in_motion_under_a_name_of_its_own_and_drops_frames(tmp_path, capsys):
    command = ["datasets", "make", "office", "--frames", "12", "--size", "32x24", "--noise", "none"]
    command += ["--motion", "fast-rotation", "--out", str(tmp_path / "made")]
    assert main([*command, "--drop", "0.4"]) == 0
    made = open_sequence(tmp_path / "made")
    assert made.name == "office-fast-rotation"
    assert 4 <= len(made) < 12
    assert f"{len(made)} frames" in capsys.readouterr().out
    whole = with_motion(SCENES["office"], "fast-rotation").poses(regular_timestamps(12), 7)
    np.testing.assert_allclose(made.truth, whole[np.rint(made.timestamps * 30).astype(int)], atol=1e-9)
