"""Ferns tell places apart and know one again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam.elasticfusion.loops.ferns import FERNS, UNSEEN, Ferns, channels, overlap
from slam.elasticfusion.loops.graph import Deformation, Graph
from tests.slam.elasticfusion.walk import CAMERA, pose, view
from tests.slam.numpy_kernels.dense import exponential

ANGLES = np.linspace(0, 2 * np.pi, 12, endpoint=False)


def ferns(seed: int = 0) -> Ferns:
    """With a keyframe of each of twelve directions, at ticks 1 to 12."""
    result = Ferns(CAMERA, depth_cutoff=4.0, seed=seed)
    for tick, angle in enumerate(ANGLES, start=1):
        assert result.add(view(pose(angle)), pose(angle), tick, 0.3095)
    return result


@pytest.mark.parametrize("number", range(12))
def test_a_place_is_known_again_from_nearby_and_through_noise(number):
    near = exponential(np.array([0.02, -0.02, 0.03, 0.01, 0.03, -0.02])) @ pose(ANGLES[number])
    database = ferns()
    code = database.encode(view(near, noise=number))
    assert database.most_similar(code, before=13) == number
    assert database.agreement(code, number) > 0.3


def test_a_view_is_kept_only_where_none_is_like_it():
    database = ferns()
    assert not database.add(view(pose(ANGLES[3]), noise=5), pose(ANGLES[3]), 20, 0.3095)
    assert database.add(view(pose(ANGLES[3] + 0.25)), pose(ANGLES[3] + 0.25), 21, 0.3095)
    assert [key.tick for key in database.keyframes] == [*range(1, 13), 21]


def test_only_what_is_old_enough_is_found():
    database = ferns()
    code = database.encode(view(pose(ANGLES[6])))
    assert database.most_similar(code, before=8) == 6  # whose tick is 7
    assert database.most_similar(code, before=7) != 6
    assert database.most_similar(code, before=1) is None


def test_pixels_without_depth_match_nothing():
    database = ferns()
    whole = view(pose(ANGLES[2]))
    half = replace(whole, depth=np.where(np.arange(80) < 40, whole.depth, 0).astype(np.float32))
    blind = replace(whole, depth=np.zeros_like(whole.depth))
    code = database.encode(half)
    assert 0.3 < (code == UNSEEN).mean() < 0.7
    assert database.dissimilarities(code)[2] == 0  # all that both have seen is equal
    assert database.agreement(code, 2) == 1
    assert (database.dissimilarities(database.encode(blind)) == 1).all()
    assert database.agreement(database.encode(blind), 2) == 0
    assert not database.add(blind, np.eye(4), 30, 0.3095)
    assert not Ferns(CAMERA, 4.0, 0).add(blind, np.eye(4), 1, 0.3095)


def test_dissimilarity_is_the_share_of_differing_ferns():
    database = ferns()
    code = database.encode(view(pose(ANGLES[4])))
    changed = code.copy()
    changed[:100] ^= 1
    assert database.dissimilarities(code)[4] == 0
    assert database.dissimilarities(changed)[4] == pytest.approx(100 / FERNS)


def test_equal_seeds_give_equal_codes():
    picture = view(pose(1.0))
    np.testing.assert_array_equal(ferns(3).encode(picture), ferns(3).encode(picture))
    assert not np.array_equal(ferns(3).encode(picture), ferns(4).encode(picture))


def test_colours_are_compared_where_the_motion_takes_them():
    database = ferns()
    key = database.keyframes[5]
    there = pose(ANGLES[5] + 0.1)
    seen = view(there)
    true_motion = np.linalg.inv(key.pose) @ there
    distance = database.colour_distance(seen, key, true_motion)
    assert distance < 25
    assert distance < 0.5 * database.colour_distance(seen, key, np.eye(4))
    behind = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert database.colour_distance(seen, key, behind) == np.inf


def test_views_overlap_where_both_have_measured():
    there = pose(ANGLES[5])
    whole = view(there)
    half = replace(whole, normals=np.where(np.arange(80)[:, None] < 40, whole.normals, 0).astype(np.float32))
    assert overlap(whole, whole, np.eye(4)) == 1
    assert overlap(half, whole, np.eye(4)) == overlap(whole, half, np.eye(4)) == 0.5
    aside = pose(ANGLES[5] + 0.2)
    assert 0.7 < overlap(view(aside), whole, np.linalg.inv(there) @ aside) < 0.9
    assert overlap(whole, whole, np.diag([-1.0, 1.0, -1.0, 1.0])) == 0


def test_points_are_those_of_every_tenth_fern_that_saw_something():
    database = ferns()
    points = database.points(view(pose(0.3), noise=1), 10)
    rows, columns = database.rows[::10], database.columns[::10]
    depth = view(pose(0.3), noise=1).depth[rows, columns]
    expected = np.column_stack(
        [(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(50)]
    )
    np.testing.assert_allclose(points, (expected * depth[:, None])[depth > 0], rtol=1e-6)


def test_keyframes_move_with_the_map():
    database = ferns()
    random = np.random.default_rng(0)
    nodes = Graph(random.uniform(-2, 2, (30, 3)), np.arange(30))
    shift = Deformation(nodes, np.tile(np.eye(3), (30, 1, 1)), np.full((30, 3), 0.25))
    before = [key.pose for key in database.keyframes]
    database.deform(shift)
    for key, old in zip(database.keyframes, before, strict=True):
        np.testing.assert_allclose(key.pose[:3, 3], old[:3, 3] + 0.25, atol=1e-12)
    assert database.most_similar(database.encode(view(pose(ANGLES[8]))), before=13) == 8


def test_channels_of_packed_colours():
    np.testing.assert_array_equal(channels(np.array([0x0302FF], np.uint32)), [[255, 2, 3]])
