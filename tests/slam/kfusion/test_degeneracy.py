"""What is seen holds the camera in every direction, or it does not."""

import numpy as np
import pytest

from slam.benchmark import run
from slam.camera import Camera
from slam.kfusion.degeneracy import WEAK_DIRECTION, is_degenerate, weakest_direction
from slam.reports.report import summary
from tests.slam.sequences import ArraySequence

CAMERA = Camera(120.0, 120.0, 79.5, 59.5, 160, 120)
FRAMES = 10


def equations(points, normals):
    """The upper triangle of J^T J of point-to-plane rows [n, p x n]."""
    rows = np.hstack([normals, np.cross(points, normals)])
    return (rows.T @ rows)[np.triu_indices(6)]


def on_planes(normals, centre, count=300):
    """Points about 1.5 m from `centre` on planes with these normals, and the normals of each."""
    rng = np.random.default_rng(4)
    points, directions = [], []
    for normal in np.array(normals, float):
        spread = rng.uniform(-1, 1, (count, 3))
        points.append(centre + 1.5 * normal + spread - np.outer(spread @ normal, normal))
        directions.append(np.tile(normal, (count, 1)))
    return np.concatenate(points), np.concatenate(directions)


@pytest.mark.parametrize("centre", [(0, 0, 0), (2.5, 2.5, 0.5), (40, -3, 7)], ids=str)
@pytest.mark.parametrize(
    ("normals", "degenerate"),
    [
        ([(0, 0, 1)], True),  # a wall
        ([(0, 0, 1), (0, 1, 0)], True),  # a wall and the floor: free along the edge
        ([(0, 0, 1), (0, 1, 0), (1, 0, 0)], False),  # a corner
    ],
    ids=["wall", "edge", "corner"],
)
def test_a_direction_that_no_surface_holds_is_found_wherever_the_volume_lies(centre, normals, degenerate):
    points, directions = on_planes(normals, np.array(centre, float))
    matrix = equations(points, directions)
    assert is_degenerate(matrix, len(points), np.array(centre)) == degenerate
    assert (weakest_direction(matrix, len(points), np.array(centre)) < 1e-6) == degenerate


def test_without_inliers_nothing_holds_the_camera():
    assert weakest_direction(np.zeros(21), 0, np.zeros(3)) == 0 < WEAK_DIRECTION


def wall(corner):
    """A wall that the camera slides along, 5 mm a frame; `corner` adds a wall beside it and a floor."""
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    ray_x, ray_y = (x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy
    truth = np.tile(np.eye(4), (FRAMES, 1, 1))
    truth[:, 0, 3] = 0.005 * np.maximum(np.arange(FRAMES) - 3, 0)
    images = []
    for pose in truth:
        depth = np.full(x.shape, 1.5)
        if corner:
            with np.errstate(divide="ignore"):
                side, floor = (0.6 - pose[0, 3]) / ray_x, 0.5 / ray_y
            for plane in (side, floor):
                depth = np.where((plane > 0) & (plane < depth), plane, depth)
        images.append(np.rint(1000 * depth))
    sequence = ArraySequence(images, truth=truth, volume_size=3.2, initial_position=(0.5, 0.5, 0.1))
    sequence.camera = CAMERA
    return sequence


@pytest.mark.slow
@pytest.mark.parametrize("corner", [False, True], ids=["wall", "corner"])
def test_a_report_tells_where_the_camera_was_free_to_slide(corner):
    report = run({"volume_resolution": 128}, wall(corner)).to_dict()
    assert [frame["tracked"] for frame in report["frames"]] == [None] * 4 + [True] * 6
    assert [frame["degenerate"] for frame in report["frames"]] == [None] * 4 + [not corner] * 6
    assert ("degenerate 6" in summary(report)) == (not corner)
