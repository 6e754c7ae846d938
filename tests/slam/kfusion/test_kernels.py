"""Every kernel gives what its NumPy reference gives, on every device present."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from slam.camera import Camera
from slam.dense.images import halved, intrinsics
from slam.devices.layout import SUMS
from slam.dense.reference import exponential, half_sample, normal_map, vertex_map
from slam.kfusion import preprocessing, raycasting, reference, tracking, volume
from slam.kfusion.pipeline import STATE
from tests.slam.dense.scenes import CAMERA, MIRRORED, image, planes, room_depth

SIZE, RESOLUTION, MU = 2.4, 36, 0.25
VOXEL = SIZE / RESOLUTION
BLOCKS = 5


def pose_at(
    position: tuple[float, float, float], twist: tuple[float, float, float] = (0, 0, 0)
) -> np.ndarray:
    pose = exponential(np.array([0, 0, 0, *twist], float))
    pose[:3, 3] = position
    return pose


def state_of(pose: np.ndarray, **values: object) -> np.ndarray:
    state = np.zeros(1, STATE)
    state["pose"] = pose[:3].ravel()
    for name, value in values.items():
        state[name] = value
    return state


def packed(distances: np.ndarray) -> np.ndarray:
    """Words of the volume: each voxel's distance below that of its neighbour in x."""
    own = np.rint(distances * volume.SCALE).astype(np.int16).view(np.uint16).astype(np.uint32)
    next_in_x = np.concatenate([own[..., 1:], own[..., -1:]], axis=-1)
    return own | next_in_x << 16


def unpacked(words: np.ndarray) -> np.ndarray:
    return (words & 0xFFFF).astype(np.uint16).view(np.int16) / volume.SCALE


def marks_of(distances: np.ndarray) -> np.ndarray:
    blocks = -(-len(distances) // volume.BLOCK)
    marks = np.zeros((blocks,) * 3, np.int32)
    z, y, x = np.nonzero(distances < 0.8)
    marks[z // volume.BLOCK, y // volume.BLOCK, x // volume.BLOCK] = 1
    return marks


def test_farthest_depth(launch):
    depth = np.random.default_rng(1).uniform(0, 9, (30, 40)).astype(np.float32)
    rows, state = np.zeros(len(depth), np.float32), state_of(np.eye(4))
    launch(preprocessing.SOURCE, "farthest_of_rows", (len(rows),), depth, depth.shape[1], rows)
    np.testing.assert_array_equal(rows, reference.farthest_of_rows(depth))
    launch(preprocessing.SOURCE, "farthest_depth", (1,), rows, len(rows), state)
    assert state["farthest"][0] == reference.farthest_depth(rows)


def tracking_problem() -> dict[str, np.ndarray]:
    """Depth seen from a pose slightly off the one that the model was raycast from."""
    fine, model_camera = room_depth(CAMERA).astype(float), CAMERA
    model_pose = pose_at((1.2, 1.1, 0.1), (0.02, -0.01, 0.03))
    rotation, translation = model_pose[:3, :3], model_pose[:3, 3]
    camera = halved(CAMERA)
    depth = half_sample(fine, 0.3)
    return {
        "depth": depth,
        "normals": normal_map(depth, camera),
        "model_vertices": vertex_map(fine, model_camera) @ rotation.T + translation,
        "model_normals": normal_map(fine, model_camera) @ rotation.T,
        "view": reference.view_from(model_pose, model_camera),
        "pose": exponential(np.array([0.01, -0.006, 0.012, 0.004, 0.006, -0.005])) @ model_pose,
    }


def track(launch, session, problem, state, iteration: int = 0) -> np.ndarray:
    """The records that the kernel leaves; those that it does not write hold 5."""
    camera = halved(CAMERA)
    count, size, group = session.layout.sums(camera.width, camera.height)
    records = np.full((count, SUMS), 5, np.float32)
    launch(
        tracking.SOURCE, "track", size, problem["depth"].astype(np.float32), *planes(problem["normals"]),
        camera.width, camera.height, intrinsics(camera), *planes(problem["model_vertices"]),
        *planes(problem["model_normals"]), CAMERA.width, CAMERA.height, 0.1, 0.8, iteration, state, records,
        group=group,
    )  # fmt: skip
    return records


def test_track_sums_the_normal_equations(launch, session):
    problem, camera = tracking_problem(), halved(CAMERA)
    state = state_of(problem["pose"], view=problem["view"].ravel())
    sums = track(launch, session, problem, state, iteration=0)
    matrix, right_side, squared_error, inliers = reference.track(
        problem["depth"], problem["normals"], camera, problem["model_vertices"], problem["model_normals"],
        problem["pose"], problem["view"], 0.1, 0.8,
    )  # fmt: skip
    total = sums.sum(axis=0, dtype=float)
    assert inliers > 100
    assert abs(total[28] - inliers) <= 1  # one pixel may fall on the other side of a threshold
    np.testing.assert_allclose(total[:21], matrix[np.triu_indices(6)], rtol=0.02, atol=0.02 * inliers)
    np.testing.assert_allclose(total[21:27], right_side, rtol=0.02, atol=0.02 * abs(right_side).max())
    assert total[27] == pytest.approx(squared_error, rel=0.02)


def test_track_of_a_converged_level_does_nothing(launch, session):
    problem = tracking_problem()
    state = state_of(problem["pose"], view=problem["view"].ravel(), converged=1)
    sums = track(launch, session, problem, state, iteration=1)
    launch(tracking.SOURCE, "solve", (1,), sums, len(sums), 1e-5, 1, state)
    assert (sums == 5).all()
    np.testing.assert_array_equal(state["pose"][0], problem["pose"][:3].ravel().astype(np.float32))


def test_track_trusts_no_index_made_of_nan(launch, session):
    """A pose or a view full of NaN associates nothing, instead of reading somewhere."""
    problem = tracking_problem()
    for poisoned in ("pose", "view"):
        state = state_of(problem["pose"], view=problem["view"].ravel())
        state[poisoned] = np.nan
        sums = track(launch, session, problem, state, iteration=0)
        assert sums[:, 28].sum() == 0


def row_sums(matrix: np.ndarray, right_side: np.ndarray, error: float = 0.5, inliers: int = 64) -> np.ndarray:
    sums = np.zeros((3, SUMS), np.float32)
    record = np.concatenate([matrix[np.triu_indices(6)], right_side, [error, inliers]])
    sums[:, :29] = record * np.array([[0.25], [0.5], [0.25]])
    return sums


@pytest.mark.parametrize("scale", [1e-4, 0.02, 0.8], ids=["tiny", "usual", "large"])
def test_solve_moves_the_pose(launch, scale):
    random = np.random.default_rng(5)
    jacobians = random.normal(size=(200, 6))
    matrix, right_side = jacobians.T @ jacobians, jacobians.T @ (jacobians @ random.normal(size=6)) * scale
    pose = pose_at((1.0, 2.0, 0.5), (0.3, -0.2, 0.1))
    state = state_of(pose)
    launch(tracking.SOURCE, "solve", (1,), row_sums(matrix, right_side), 3, 0.01, 0, state)
    expected, converged = reference.solve(matrix, right_side, pose, 0.01)
    np.testing.assert_allclose(state["pose"][0].reshape(3, 4), expected[:3], atol=2e-5)
    assert bool(state["converged"][0]) == converged == (scale < 1e-3)
    assert (state["squared_error"][0], state["inliers"][0]) == (0.5, 64)


def test_solve_leaves_unobserved_directions_alone(launch):
    """A plane says nothing about sliding along it: the truncated solution does not slide."""
    jacobian = np.array([[0, 0, 1, 0.5, -0.25, 0], [0, 0, 1, -0.5, 0.5, 0], [0, 0, 1, 0.1, 0.9, 0]], float)
    matrix, right_side = jacobian.T @ jacobian, jacobian.T @ np.array([0.01, 0.02, -0.01])
    pose = pose_at((1.0, 1.0, 1.0))
    state = state_of(pose)
    launch(tracking.SOURCE, "solve", (1,), row_sums(matrix, right_side), 3, 0.0, 0, state)
    expected, _ = reference.solve(matrix, right_side, pose, 0.0)
    np.testing.assert_allclose(state["pose"][0].reshape(3, 4), expected[:3], atol=1e-5)


def test_solve_of_nothing_keeps_the_pose(launch):
    pose = pose_at((1.0, 2.0, 0.5), (0.3, -0.2, 0.1))
    state = state_of(pose)
    launch(tracking.SOURCE, "solve", (1,), np.zeros((3, SUMS), np.float32), 3, 1e-5, 0, state)
    np.testing.assert_allclose(state["pose"][0].reshape(3, 4), pose[:3], atol=1e-6)
    assert state["converged"][0] == 1


@pytest.mark.parametrize(
    ("squared_error", "inliers", "good"),
    [(0.02, 200, True), (0.2, 200, False), (0.001, 100, False), (0.0, 0, False), (np.nan, 200, False)],
)
def test_check_pose_goes_back_when_lost(launch, squared_error, inliers, good):
    before, after = pose_at((1, 1, 1)), pose_at((1.1, 1, 1))
    state = state_of(before)
    launch(tracking.SOURCE, "begin_tracking", (1,), state)
    np.testing.assert_array_equal(state["previous"][0].reshape(3, 4), reference.begin_tracking(before)[:3])
    state["pose"], state["squared_error"], state["inliers"] = after[:3].ravel(), squared_error, inliers
    launch(tracking.SOURCE, "check_pose", (1,), 1000, 0.02, 0.15, state)
    assert bool(state["tracked"][0]) == good
    if not np.isnan(squared_error):
        assert reference.check_pose(squared_error, inliers, 1000, 0.02, 0.15) == good
    np.testing.assert_allclose(state["pose"][0].reshape(3, 4), (after if good else before)[:3], atol=1e-7)


def test_clear_volume(launch):
    voxels, weights = np.ones((RESOLUTION,) * 3, np.uint32), np.ones((RESOLUTION,) * 3, np.uint8)
    marks = np.ones((BLOCKS,) * 3, np.int32)
    launch(volume.SOURCE, "clear_volume", (RESOLUTION,), voxels, weights, RESOLUTION, marks, BLOCKS)
    expected_distances, expected_weights = reference.clear_volume(RESOLUTION)
    np.testing.assert_array_equal(voxels, packed(expected_distances))
    np.testing.assert_array_equal(weights, expected_weights)
    assert not marks.any()


def integrate(launch, session, voxels, weights, marks, depth, camera, pose, max_weight=100.0) -> None:
    size, group = volume.lines_of(session.layout, RESOLUTION)
    launch(
        volume.SOURCE, "integrate", size, voxels, weights, RESOLUTION, VOXEL, marks, BLOCKS, depth,
        camera.width, camera.height, intrinsics(camera), MU, max_weight, volume.NEAR_SURFACE,
        state_of(pose, farthest=depth.max()), group=group,
    )  # fmt: skip


@pytest.mark.parametrize("camera", [CAMERA, MIRRORED], ids=["plain", "mirrored"])
@pytest.mark.parametrize(
    "twist", [(0, 0, 0), (0.3, -0.4, 0.2), (0, 1.5707963, 0)], ids=["straight", "askew", "side"]
)
def test_integrate_twice(launch, session, camera, twist):
    pose = pose_at((1.2, 1.1, 0.15) if not twist[1] > 1 else (0.1, 1.1, 1.2), twist)
    distances, weights = reference.clear_volume(RESOLUTION)
    voxels, got_weights = packed(distances), weights.astype(np.uint8)
    marks = np.zeros((BLOCKS,) * 3, np.int32)
    for seed in (0, 1):
        depth = room_depth(camera, seed)
        distances, weights = reference.integrate(
            distances, weights, VOXEL, depth.astype(float), camera, pose, MU, 100
        )
        integrate(launch, session, voxels, got_weights, marks, depth, camera, pose)
    got_distances = unpacked(voxels)
    differing = (abs(got_distances - distances) > 2e-4) | (got_weights != weights)
    assert (weights == 2).sum() > 500
    assert differing.mean() < 1e-3  # a voxel's centre may fall on the other side of a pixel's border
    np.testing.assert_array_equal(voxels, packed(got_distances))  # every copy of a neighbour is up to date
    expected_marks = marks_of(np.where(weights > 0, distances, 1.0))
    assert abs(marks - expected_marks).mean() < 0.02


def test_integrate_stops_at_the_largest_weight(launch, session):
    distances, weights = reference.clear_volume(RESOLUTION)
    voxels, got_weights = packed(distances), (weights + 3).astype(np.uint8)
    marks = np.zeros((BLOCKS,) * 3, np.int32)
    pose = pose_at((1.2, 1.1, 0.15))
    integrate(launch, session, voxels, got_weights, marks, room_depth(CAMERA), CAMERA, pose, max_weight=3.0)
    assert got_weights.max() == 3
    assert (unpacked(voxels) < 1).any()


def test_dilate_blocks(launch):
    marks = (np.random.default_rng(6).random((BLOCKS,) * 3) < 0.1).astype(np.int32)
    searched = np.zeros_like(marks)
    launch(volume.SOURCE, "dilate_blocks", (BLOCKS, BLOCKS), marks, searched, BLOCKS)
    np.testing.assert_array_equal(searched > 0, reference.dilate_blocks(marks > 0))


def test_view_from(launch):
    pose = pose_at((1.2, 0.4, 0.9), (0.5, -0.7, 0.2))
    state = state_of(pose)
    launch(raycasting.SOURCE, "view_from", (1,), intrinsics(MIRRORED), state)
    np.testing.assert_allclose(
        state["view"][0].reshape(3, 4), reference.view_from(pose, MIRRORED), rtol=1e-5, atol=1e-5
    )


@functools.cache
def raycast_case(mu: float, twist: tuple[float, float, float]) -> tuple:
    """A camera, what it looks into, its pose, and what the reference sees: computed once for all devices."""
    camera = Camera(30.0, 31.0, 19.3, 14.6, 37, 30)
    distances, weights = reference.clear_volume(RESOLUTION)
    distances, weights = reference.integrate(
        distances, weights, VOXEL, room_depth(CAMERA).astype(float), CAMERA, pose_at((1.2, 1.1, 0.1)), mu, 100
    )
    voxels = packed(distances)
    pose = pose_at((1.15, 1.12, 0.12), twist)
    expected = reference.raycast(unpacked(voxels), VOXEL, pose, camera, 0.4, 4.0, VOXEL, 0.75 * mu)
    return camera, voxels, pose, expected


@pytest.mark.parametrize("mu", [0.08, 0.25, 0.6], ids=["thin", "usual", "thick"])
@pytest.mark.parametrize("twist", [(0, 0, 0), (0.25, -0.3, 0.1)], ids=["straight", "askew"])
def test_raycast(launch, mu, twist):
    """Also with truncation bands thinner than a voxel and wider than the scene."""
    camera, voxels, pose, (vertices, normals) = raycast_case(mu, twist)
    searched = reference.dilate_blocks(marks_of(unpacked(voxels)) > 0).astype(np.int32)
    maps = [np.full((camera.height, camera.width), 7, np.float32) for _ in range(6)]
    launch(
        raycasting.SOURCE, "raycast", image(camera), voxels, RESOLUTION, VOXEL, searched, BLOCKS,
        camera.width, camera.height, intrinsics(camera), 0.4, 4.0, VOXEL, 0.75 * mu, volume.NEAR_SURFACE,
        state_of(pose), *maps,
    )  # fmt: skip
    found, expected = maps[3] ** 2 + maps[4] ** 2 + maps[5] ** 2 > 0, normals.any(axis=-1)
    assert expected.sum() > 200
    assert (found != expected).mean() < 0.01
    both = found & expected
    distance = np.linalg.norm(np.dstack(maps[:3]) - vertices, axis=-1)[both]
    agreement = np.sum(np.dstack(maps[3:]) * normals, axis=-1)[both]
    assert np.median(distance) < 1e-5
    assert (distance > 1e-3).mean() < 0.01
    assert (agreement < 0.999).mean() < 0.01
    assert not np.dstack(maps)[~found].any()


def test_raycast_sees_nothing_in_an_empty_volume_or_from_outside_it(launch):
    distances, _ = reference.clear_volume(RESOLUTION)
    searched = np.zeros((BLOCKS,) * 3, np.int32)
    for pose in (pose_at((1.2, 1.1, 0.1)), pose_at((9.0, 9.0, 9.0))):
        maps = [np.full((CAMERA.height, CAMERA.width), 7, np.float32) for _ in range(6)]
        launch(
            raycasting.SOURCE, "raycast", image(CAMERA), packed(distances), RESOLUTION, VOXEL,
            searched, BLOCKS, CAMERA.width, CAMERA.height, intrinsics(CAMERA), 0.4, 4.0, VOXEL, 0.75 * MU,
            volume.NEAR_SURFACE, state_of(pose), *maps,
        )  # fmt: skip
        assert not np.dstack(maps).any()
