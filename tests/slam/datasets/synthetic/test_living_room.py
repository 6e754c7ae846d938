import functools

import numpy as np
import pytest

from slam.datasets import open_sequence
from slam.datasets.sequence import regular_timestamps
from slam.datasets.synthetic.camera_paths import hand_held, loop
from slam.datasets.synthetic.rendering import SyntheticSequence
from slam.datasets.synthetic.scenes.living_room import HAND, LOOP, living_room
from tests.shipped import LIVING_ROOM


@pytest.fixture(scope="module")
def shipped():
    return open_sequence(LIVING_ROOM)


@pytest.fixture(scope="module")
def made():
    sequence = SyntheticSequence(HAND)
    sequence.depth = functools.cache(sequence.depth)  # each frame is rendered once
    return sequence


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 47, 99])
def test_the_shipped_frames_can_be_made_again(shipped, made, index):
    difference = np.abs(shipped.depth(index).astype(int) - made.depth(index))
    assert (difference > 1).mean() <= 0.001


def test_the_shipped_pack_is_whole_and_small(shipped):
    shipped.verify()
    assert sum(chunk["bytes"] for chunk in shipped.manifest["chunks"]) <= 20e6
    assert (len(shipped), shipped.camera, shipped.volume_size) == (100, SyntheticSequence(HAND).camera, 4.8)


def test_the_shipped_truth_is_the_path_of_the_camera(shipped, made):
    np.testing.assert_allclose(shipped.truth, made.truth, atol=1e-9)
    np.testing.assert_allclose(shipped.timestamps, made.timestamps, atol=1e-12)


def test_the_camera_holds_still_for_four_frames_and_then_moves_as_a_hand_does(made):
    steps = np.linalg.norm(np.diff(made.truth[:, :3, 3], axis=0), axis=1)
    assert steps[:3].max() == 0
    assert 0.008 < steps.mean() < 0.012
    assert steps.max() < 0.03


@pytest.mark.slow
def test_exact_depth_agrees_from_frame_to_frame():
    """Points of one frame, moved by the true poses, lie on the surface that the other frame sees."""
    room = SyntheticSequence(HAND, 60, noise="none")
    camera = room.camera
    first, second = room.depth(40) / 1000, room.depth(46) / 1000
    v, u = np.mgrid[0:480:3, 0:640:3]
    z = first[v, u]
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)[z > 0]
    motion = np.linalg.inv(room.truth[46]) @ room.truth[40]
    x, y, z = (points @ motion[:3, :3].T + motion[:3, 3]).T
    u, v = np.rint(camera.fx * x / z + camera.cx), np.rint(camera.fy * y / z + camera.cy)
    visible = (u >= 0) & (u < 640) & (v >= 0) & (v < 480)
    u, v, z = u[visible].astype(int), v[visible].astype(int), z[visible]
    error = np.abs(second[v, u] - z)[second[v, u] > 0]
    assert np.median(error) < 0.002
    assert np.mean(error < 0.02) > 0.9


@pytest.mark.slow
def test_the_scene_lies_inside_the_volume_that_travels_with_it(made):
    """Seen from the first camera, whose axes are the volume's, nothing that is measured lies outside."""
    camera, size = made.camera, made.volume_size
    start = np.array(made.initial_position) * size
    v, u = np.mgrid[0:480:16, 0:640:16]
    for index in (0, 99):
        z = made.depth(index)[v, u] / 1000
        points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)[
            z > 0
        ]
        motion = np.linalg.inv(made.truth[0]) @ made.truth[index]
        inside = points @ motion[:3, :3].T + motion[:3, 3] + start
        assert np.mean(((inside > 0) & (inside < size)).all(axis=1)) > 0.99


@pytest.mark.slow
def test_colour_shows_the_same_things_as_depth():
    room = SyntheticSequence(HAND, 1)
    image = room.colour(0)
    assert image.shape == (480, 640, 3)
    assert image.std() > 20


def test_the_seed_changes_noise_tremor_and_books_and_nothing_else_does():
    stamps = regular_timestamps(20)
    np.testing.assert_array_equal(hand_held(stamps, 1), hand_held(stamps, 1))
    assert np.abs(hand_held(stamps, 1) - hand_held(stamps, 2)).max() > 1e-4
    one, two = living_room(1), living_room(2)
    assert [a.kind for a in one[:60]] == [b.kind for b in two[:60]]
    assert any(not np.array_equal(a.half, b.half) for a, b in zip(one, two, strict=False))


def test_a_room_without_frames_is_refused():
    with pytest.raises(ValueError, match="frames=0"):
        SyntheticSequence(HAND, 0)


def test_the_loop_begins_and_ends_slowly_and_shows_the_start_again_after_one_turn():
    truth = loop(regular_timestamps(400))
    steps = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)
    assert max(steps[0], steps[-1]) < 0.5 * np.median(steps)
    assert steps.max() < 0.012
    facing = truth[:, :3, 2] @ truth[0, :3, 2]
    assert facing.min() < -0.8
    after = 250 + np.argmax(facing[250:])
    assert facing[after] > 0.99
    assert after < 380
    assert np.linalg.norm(truth[after, :3, 3] - truth[0, :3, 3]) < 0.2


@pytest.mark.slow
def test_the_loop_has_texture_and_depth_to_hold_on_to_wherever_it_looks():
    room = SyntheticSequence(LOOP, noise="none", ratio=4)
    assert (room.camera.width, room.camera.height, room.camera.fx) == (160, 120, 481.2 / 4)
    for index in range(0, 400, 50):
        depth, grey = room.depth(index), room.colour(index).mean(axis=2)
        assert (depth > 0).mean() > 0.85
        assert depth.max() < 4500
        assert np.abs(np.diff(grey, axis=1)).mean() > 4


def test_what_is_added_for_the_loop_leaves_the_path_of_the_hand_as_it_was():
    plain, whole = living_room(7), living_room(7, all_around=True)
    assert [shape.kind for shape in whole[: len(plain)]] == [shape.kind for shape in plain]
    assert {shape.pattern for shape in whole} - {shape.pattern for shape in plain} == {"paper"}
