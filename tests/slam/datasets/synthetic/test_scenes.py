import numpy as np
import pytest

from slam.datasets.sequence import regular_timestamps
from slam.datasets.synthetic.rendering import SyntheticSequence
from slam.datasets.synthetic.scenes import SCENES, with_role

NEW = [scene for scene in SCENES.values() if not scene.name.startswith("living-room")]
RATIO = 16  # 40x30


@pytest.fixture(params=NEW, ids=lambda scene: scene.name)
def scene(request):
    return request.param


def steps(scene, count=100):
    truth = scene.poses(regular_timestamps(count), 7)
    return np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)


def test_there_are_five_sequences_to_learn_on_and_two_held_out():
    assert len(with_role("learned-on")) >= 5
    assert len(with_role("held-out")) >= 2
    assert [scene.frames >= 300 for scene in with_role("loop")] == [True, True]


def test_a_scene_has_a_name_and_a_line_that_describe_it(scene):
    assert SCENES[scene.name] is scene
    assert len(scene.summary) < 90


@pytest.mark.slow
def test_equal_seeds_give_equal_frames_and_other_seeds_other_rooms(scene):
    one, two = (SyntheticSequence(scene, 3, ratio=RATIO) for _ in range(2))
    np.testing.assert_array_equal(one.depth(1), two.depth(1))
    np.testing.assert_array_equal(one.colour(1), two.colour(1))
    np.testing.assert_array_equal(one.truth, two.truth)
    assert (SyntheticSequence(scene, 3, seed=8, ratio=RATIO).depth(1) != one.depth(1)).any()


def test_the_camera_holds_still_for_four_frames(scene):
    assert steps(scene)[:3].max() == 0


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("desk", 4, 7), ("kitchen", 16, 20), ("corridor", 18, 23), ("attic", 9, 14), ("workshop", 20, 25),
     ("library", 11, 16), ("studio-loop", 15, 21)],
)  # fmt: skip
def test_the_speed_is_the_one_that_the_scene_states(name, least, most):
    """In millimetres a frame, once the camera is under way."""
    assert least < 1000 * steps(SCENES[name])[10:].mean() < most


def test_the_office_camera_turns_more_than_it_moves():
    truth = SCENES["office"].poses(regular_timestamps(100), 7)
    traces = np.einsum("nij,nij->n", truth[:-1, :3, :3], truth[1:, :3, :3])
    degrees = np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1)))
    assert 1.1 < degrees[10:].mean() < 1.6
    assert 1000 * steps(SCENES["office"])[10:].mean() < 7


@pytest.mark.slow
def test_what_is_measured_lies_inside_the_volume_and_holes_leave_enough(scene):
    """Seen from the first camera, whose axes are the volume's."""
    sequence = SyntheticSequence(scene, ratio=8)
    camera, size = sequence.camera, scene.volume_size
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    for index in np.linspace(0, len(sequence) - 1, 4).astype(int):
        depth = sequence.depth(index) / 1000
        seen = depth > 0
        assert 0.4 < seen.mean() < 0.98
        motion = np.linalg.inv(sequence.truth[0]) @ sequence.truth[index]
        points = (rays[seen] * depth[seen][:, None]) @ motion[:3, :3].T + motion[:3, 3]
        inside = points + np.array(scene.initial_position) * size
        assert ((inside > 0) & (inside < size)).all(axis=1).mean() > 0.99


@pytest.mark.slow
def test_hardly_anything_is_nearer_than_a_kinect_measures(scene):
    exact = SyntheticSequence(scene, noise="none", ratio=RATIO)
    for index in range(0, len(exact), 30):
        depth = exact.depth(index)
        assert (depth[depth > 0] < 400).mean() < 0.1


def test_the_studio_comes_back_to_where_it_began():
    scene = SCENES["studio-loop"]
    truth = scene.poses(regular_timestamps(scene.frames), 7)
    away = np.linalg.norm(truth[:, :3, 3] - truth[0, :3, 3], axis=1)
    assert away.max() > 2
    back = 300 + int(np.argmin(away[300:]))
    assert away[back] < 0.05
    assert back < scene.frames - 20
    assert truth[back, :3, 2] @ truth[0, :3, 2] > 0.99
