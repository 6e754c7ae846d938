"""What a deformation graph connects, and what its nodes move."""

from __future__ import annotations

import numpy as np
import pytest

from slam.camera import Camera
from slam.elasticfusion.loops.graph import (
    CANDIDATES,
    MOST_NODES,
    Deformation,
    Graph,
    nearest_rotations,
    sampling,
)
from tests.slam.numpy_kernels.dense import exponential


def graph(nodes: int = 50, seed: int = 0, ties: int = 0) -> Graph:
    """Nodes scattered over a few metres, the first `ties` of them of tick 1."""
    random = np.random.default_rng(seed)
    times = np.sort(random.integers(2, 3 * nodes, nodes))
    times[:ties] = 1
    return Graph(random.uniform(-2, 2, (nodes, 3)), times)


def rigid(nodes: Graph, motion: np.ndarray) -> Deformation:
    """Every node moves its neighbourhood by one and the same rigid motion."""
    turned = nodes.positions @ motion[:3, :3].T + motion[:3, 3]
    return Deformation(nodes, np.tile(motion[:3, :3], (len(nodes), 1, 1)), turned - nodes.positions)


def test_every_node_has_its_four_neighbours_in_time():
    edges = graph(9).edges()
    neighbours = {int(i): sorted(edges[edges[:, 0] == i, 1].tolist()) for i in range(9)}
    assert neighbours[4] == [2, 3, 5, 6]
    assert neighbours[0] == [1, 2, 3, 4]
    assert neighbours[8] == [4, 5, 6, 7]
    assert neighbours[1] == [0, 2, 3, 4]


@pytest.mark.parametrize(("nodes", "ties"), [(50, 0), (50, 35), (7, 0), (200, 60)])
def test_candidates_are_those_next_in_time_with_all_that_are_as_near(nodes, ties):
    sample = graph(nodes, ties=ties)
    for time, first, last in zip(range(3 * nodes), *sample.windows(np.arange(3 * nodes)), strict=True):
        gaps = np.abs(sample.times - time)
        farthest = np.sort(gaps)[min(CANDIDATES, nodes) - 1]
        assert np.flatnonzero(gaps <= farthest).tolist() == list(range(first, last))


def test_the_four_nearest_candidates_move_a_point_by_their_distances():
    nodes = graph(60)
    point, time = np.array([0.3, -0.2, 0.9]), 70
    chosen, weights = nodes.influence(point[None], np.array([time]))
    first, last = (int(bound[0]) for bound in nodes.windows(np.array([time])))
    distances = {i: float(np.linalg.norm(nodes.positions[i] - point)) for i in range(first, last)}
    by_distance = sorted(distances, key=distances.__getitem__)
    expected = np.array([(1 - distances[i] / distances[by_distance[4]]) ** 2 for i in by_distance[:4]])
    assert chosen[0].tolist() == by_distance[:4]
    np.testing.assert_allclose(weights[0], expected / expected.sum())


def test_nodes_that_are_equally_far_weigh_the_same():
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    chosen, weights = Graph(corners, np.arange(6)).influence(np.zeros((1, 3)), np.array([3]))
    assert chosen[0].tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(weights[0], [0.25] * 4)


def test_what_was_born_long_ago_is_not_moved_with_what_lies_on_top_of_it():
    nodes = graph(100)
    moved = Deformation(
        nodes, np.tile(np.eye(3), (100, 1, 1)), np.where(nodes.times > 150, 1.0, 0.0)[:, None] * np.ones(3)
    )
    place = np.zeros((2, 3))
    after, _ = moved.of_points(place, np.array([20, 280]))
    np.testing.assert_allclose(after, [[0, 0, 0], [1, 1, 1]])


def test_a_rigid_motion_of_all_nodes_moves_points_and_poses_rigidly():
    nodes = graph(40)
    motion = exponential(np.array([0.3, -0.1, 0.2, 0.1, 0.4, -0.2]))
    random = np.random.default_rng(1)
    points, times = random.uniform(-2, 2, (30, 3)), random.integers(0, 120, 30)
    poses = np.array([exponential(twist) for twist in random.normal(0, 0.5, (30, 6))])
    moved, linear = rigid(nodes, motion).of_points(points, times)
    np.testing.assert_allclose(moved, points @ motion[:3, :3].T + motion[:3, 3], atol=1e-12)
    np.testing.assert_allclose(linear, np.broadcast_to(motion[:3, :3], linear.shape), atol=1e-12)
    np.testing.assert_allclose(rigid(nodes, motion).of_poses(poses, times), motion @ poses, atol=1e-12)


def test_poses_stay_rigid_where_nodes_are_not():
    random = np.random.default_rng(2)
    nodes = graph(30)
    bent = Deformation(nodes, np.eye(3) + random.normal(0, 0.2, (30, 3, 3)), random.normal(0, 0.1, (30, 3)))
    rotations = bent.of_poses(np.tile(np.eye(4), (5, 1, 1)), np.arange(5) * 10)[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, 1, 2), np.tile(np.eye(3), (5, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1)


def test_the_nearest_rotation_of_a_reflection_is_no_reflection():
    np.testing.assert_allclose(np.linalg.det(nearest_rotations(np.diag([1.0, 1.0, -1.0])[None])), [1.0])


def test_smaller_images_and_larger_maps_are_sampled_to_a_like_number_of_nodes():
    assert sampling(300_000, Camera(500, 500, 320, 240, 640, 480)) == 5000
    assert sampling(20_000, Camera(120, 120, 80, 60, 160, 120)) == 312
    assert 9_000_000 / sampling(9_000_000, Camera(500, 500, 320, 240, 640, 480)) <= MOST_NODES
    assert sampling(0, Camera(5, 5, 1, 1, 4, 4)) == 1


def test_five_nodes_are_needed():
    assert not graph(4).usable
    assert graph(5).usable


def test_the_graph_of_global_closures_is_thinner_but_not_thin():
    assert len(graph(1000).thinned()) == 200
    assert len(graph(450).thinned()) == 225
    assert len(graph(150).thinned()) == 150
