import numpy as np
import pytest

from slam.datasets.sequence import regular_timestamps
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath, catmull_rom

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
STAMPS = regular_timestamps(120)


def path(**options):
    waypoints = tuple(Waypoint((x, 1.5, z), (x, 1.0, z + 2)) for x, _, z in SQUARE)
    return WaypointPath(lap=3.0, waypoints=waypoints, **options)


def test_the_spline_passes_through_its_points_and_closes():
    np.testing.assert_allclose(catmull_rom(SQUARE, np.arange(5) / 4), SQUARE[[0, 1, 2, 3, 0]], atol=1e-12)


def test_the_spline_has_no_corners():
    velocity = np.diff(catmull_rom(SQUARE, np.linspace(0, 2, 4001)), axis=0) * 2000
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() < 0.05


def test_the_camera_looks_at_the_target():
    poses = path(tremor=0)(STAMPS, 1)
    np.testing.assert_allclose(poses[0, :3, 3], [0, -1.5, 0])
    expected = np.array([0, 0.5, 2]) / np.hypot(0.5, 2)
    np.testing.assert_allclose(poses[0, :3, 2], expected, atol=1e-12)
    np.testing.assert_allclose(poses[:, 1, 0], 0, atol=1e-12)  # the x axis stays level
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1)


def test_a_rush_changes_the_speed_and_the_seed_only_the_tremor():
    even, rushed = (np.diff(path(rush=r, tremor=0)(STAMPS, 1)[:, :3, 3], axis=0) for r in (0, 0.6))
    spread = [np.linalg.norm(step[40:], axis=1).std() for step in (even, rushed)]
    assert spread[1] > 1.5 * spread[0]
    assert np.abs(path()(STAMPS, 1) - path()(STAMPS, 2)).max() > 1e-4
    np.testing.assert_array_equal(path(tremor=0)(STAMPS, 1), path(tremor=0)(STAMPS, 2))


def test_roll_tilts_the_camera():
    poses = path(roll=5.0, tremor=0)(STAMPS, 1)
    assert np.degrees(np.arcsin(np.abs(poses[:, 1, 0]).max())) == pytest.approx(5, abs=0.4)
