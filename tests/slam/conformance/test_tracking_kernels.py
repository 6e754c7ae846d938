"""KinectFusion's tracking kernels give what their NumPy references give, on every device of every backend."""

from __future__ import annotations

import numpy as np
import pytest

from slam.dense.images import halved
from slam.devices.layout import SOLVERS, SUMS
from tests.slam.conformance.values import camera_of, pose_at, state_of
from tests.slam.dense.scenes import CAMERA, MIRRORED, room_depth
from tests.slam.reference import kfusion as reference
from tests.slam.reference.dense import exponential, half_sample, normal_map, vertex_map

SIZE = 2.4  # m, of the volume


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
        "view": reference.begin_tracking(model_pose, model_camera),
        "pose": exponential(np.array([0.01, -0.006, 0.012, 0.004, 0.006, -0.005])) @ model_pose,
    }


def planes(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.moveaxis(image, -1, 0), np.float32)


def track(launch, session, problem, state, conditional: int = 0) -> np.ndarray:
    """The records that the kernel leaves; those that it does not write hold 5."""
    camera = halved(CAMERA)
    count, size, group = session.layout.sums(camera.width, camera.height)
    records = np.full((count, SUMS), 5, np.float32)
    launch(
        "track", (size, group), depth=problem["depth"].astype(np.float32),
        normals=planes(problem["normals"]), width=camera.width, height=camera.height,
        camera=camera_of(camera), model_vertices=planes(problem["model_vertices"]),
        model_normals=planes(problem["model_normals"]), model_width=CAMERA.width,
        model_height=CAMERA.height, max_distance=0.1, min_dot=0.8, conditional=conditional, state=state,
        records=records,
    )  # fmt: skip
    return records


def solve(launch, session, records, threshold, state, conditional: int = 0) -> None:
    launch(
        "solve", session.layout.one_group(SOLVERS), records=records, count=len(records), threshold=threshold,
        conditional=conditional, state=state,
    )  # fmt: skip


@pytest.mark.parametrize("conditional", [0, 1])
def test_track_sums_the_normal_equations(launch, session, conditional):
    problem, camera = tracking_problem(), halved(CAMERA)
    state = state_of(problem["pose"], view=problem["view"].ravel(), iterating=1)
    sums = track(launch, session, problem, state, conditional)
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
    state = state_of(problem["pose"], view=problem["view"].ravel(), iterating=0)
    sums = track(launch, session, problem, state, conditional=1)
    assert (sums == 5).all()
    solve(launch, session, sums, 1e-5, state, conditional=1)
    np.testing.assert_array_equal(state["pose"], problem["pose"][:3].ravel().astype(np.float32))
    assert state["iterating"] == 0


def test_track_trusts_no_index_made_of_nan(launch, session):
    """A pose or a view full of NaN associates nothing, instead of reading somewhere."""
    problem = tracking_problem()
    for poisoned in ("pose", "view"):
        state = state_of(problem["pose"], view=problem["view"].ravel())
        state[poisoned] = np.nan
        sums = track(launch, session, problem, state)
        assert sums[:, 28].sum() == 0


def records_of(matrix: np.ndarray, right_side: np.ndarray, parts: int = 3) -> np.ndarray:
    """Records whose sum says J^T J, J^T e, a squared error of 0.5 and 64 inliers."""
    shares = np.random.default_rng(7).dirichlet(np.ones(parts))
    record = np.concatenate([matrix[np.triu_indices(6)], right_side, [0.5, 64], np.zeros(3)])
    return (shares[:, None] * record).astype(np.float32)


@pytest.mark.parametrize("parts", [3, 301])
@pytest.mark.parametrize("scale", [1e-4, 0.02, 0.8], ids=["tiny", "usual", "large"])
def test_solve_moves_the_pose(launch, session, scale, parts):
    random = np.random.default_rng(5)
    jacobians = random.normal(size=(200, 6))
    matrix, right_side = jacobians.T @ jacobians, jacobians.T @ (jacobians @ random.normal(size=6)) * scale
    pose = pose_at((1.0, 2.0, 0.5), (0.3, -0.2, 0.1))
    state = state_of(pose, iterating=1)
    solve(launch, session, records_of(matrix, right_side, parts), 0.01, state, conditional=1)
    expected, converged = reference.solve(matrix, right_side, pose, 0.01)
    np.testing.assert_allclose(state["pose"].reshape(3, 4), expected[:3], atol=2e-5)
    assert (state["iterating"] == 0) == converged == (scale < 1e-3)
    np.testing.assert_allclose((state["squared_error"], state["inliers"]), (0.5, 64), rtol=1e-5)
    np.testing.assert_allclose(state["normal_matrix"], matrix[np.triu_indices(6)], rtol=1e-4, atol=1e-3)


def test_solve_leaves_unobserved_directions_alone(launch, session):
    """A plane says nothing about sliding along it: the truncated solution does not slide."""
    jacobian = np.array([[0, 0, 1, 0.5, -0.25, 0], [0, 0, 1, -0.5, 0.5, 0], [0, 0, 1, 0.1, 0.9, 0]], float)
    matrix, right_side = jacobian.T @ jacobian, jacobian.T @ np.array([0.01, 0.02, -0.01])
    pose = pose_at((1.0, 1.0, 1.0))
    state = state_of(pose)
    solve(launch, session, records_of(matrix, right_side), 0.0, state)
    expected, _ = reference.solve(matrix, right_side, pose, 0.0)
    np.testing.assert_allclose(state["pose"].reshape(3, 4), expected[:3], atol=1e-5)


def test_solve_of_nothing_keeps_the_pose(launch, session):
    pose = pose_at((1.0, 2.0, 0.5), (0.3, -0.2, 0.1))
    state = state_of(pose, iterating=1)
    solve(launch, session, np.zeros((3, SUMS), np.float32), 1e-5, state)
    np.testing.assert_allclose(state["pose"].reshape(3, 4), pose[:3], atol=1e-6)
    assert state["iterating"] == 0


def test_begin_tracking(launch, session):
    pose = pose_at((1.2, 0.4, 0.9), (0.5, -0.7, 0.2))
    state = state_of(pose)
    launch("begin_tracking", session.layout.one_group(1), camera=camera_of(MIRRORED), state=state)
    np.testing.assert_array_equal(state["previous"], pose[:3].ravel().astype(np.float32))
    expected = reference.begin_tracking(pose, MIRRORED)
    np.testing.assert_allclose(state["view"].reshape(3, 4), expected, rtol=1e-5, atol=1e-5)


MOTION = {"max_translation": 0.2, "max_rotation": 0.25, "volume_size": SIZE}


def check_pose(launch, session, state) -> None:
    launch(
        "check_pose", session.layout.one_group(1), pixels=1000, max_residual=0.02, min_inliers=0.15,
        near_motion=0.1, far_inliers=0.3, kept_inliers=0.75, **MOTION, state=state,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("squared_error", "inliers", "good"),
    [(0.02, 200, True), (0.2, 200, False), (0.001, 100, False), (0.0, 0, False), (np.nan, 200, False)],
)
def test_check_pose_goes_back_when_lost(launch, session, squared_error, inliers, good):
    before, after = pose_at((1, 1, 1)), pose_at((1.05, 1, 1))
    state = state_of(
        after, previous=before[:3].ravel(), squared_error=squared_error, inliers=inliers, misses=2
    )
    check_pose(launch, session, state)
    assert bool(state["tracked"]) == good
    assert state["misses"] == (0 if good else 3)
    assert state["last_inliers"] == pytest.approx(0.2 if good else 0)
    if not np.isnan(squared_error):
        assert reference.check_pose(squared_error, inliers, 1000, 0.02, 0.15) == good
    np.testing.assert_allclose(state["pose"].reshape(3, 4), (after if good else before)[:3], atol=1e-7)


@pytest.mark.parametrize(
    ("before", "after", "twist", "misses", "inliers", "good"),
    [
        ((1, 1, 1), (1.19, 1, 1), (0, 0, 0), 0, 400, True),
        ((1, 1, 1), (1.21, 1, 1), (0, 0, 0), 0, 400, False),
        ((1, 1, 1), (1.21, 1, 1), (0, 0, 0), 1, 400, True),  # twice the time
        ((1, 1, 1), (1.05, 1, 1), (0, 0.24, 0), 0, 400, True),
        ((1, 1, 1), (1.05, 1, 1), (0, 0.26, 0), 0, 400, False),
        ((1, 1, 1), (1.05, 1, 1), (0, 0.26, 0), 1, 400, True),
        ((1, 1, 1), (1.05, 1, 1), (0, 3.1, 0), 20, 400, True),  # any rotation, after so long
        ((1, 1, 1), (1.15, 1, 1), (0, 0, 0), 0, 290, False),  # beyond the distance of association
        ((1, 1, 1), (1.15, 1, 1), (0, 0, 0), 0, 310, True),
        ((1, 1, 1), (1.06, 1, 1), (0, 0.06, 0), 0, 290, False),
        ((0.05, 1, 1), (-0.01, 1, 1), (0, 0, 0), 0, 400, False),
        ((1, 1, SIZE - 0.05), (1, 1, SIZE + 0.01), (0, 0, 0), 0, 400, False),
        ((1, -0.05, 1), (1, -0.06, 1), (0, 0, 0), 0, 400, True),  # it began outside
        ((1, 1, 1), (np.nan, 1, 1), (0, 0, 0), 0, 400, False),
    ],
)
def test_check_pose_refuses_a_motion_that_is_not_possible(
    launch, session, before, after, twist, misses, inliers, good
):
    start, end = pose_at(before), pose_at(after, twist)
    state = state_of(end, previous=start[:3].ravel(), squared_error=0.01, inliers=inliers, misses=misses)
    check_pose(launch, session, state)
    assert bool(state["tracked"]) == good
    if inliers > 310 and np.isfinite(after).all():
        assert reference.motion_is_possible(start, end, misses + 1, **MOTION) == good
    np.testing.assert_allclose(state["pose"].reshape(3, 4), (end if good else start)[:3], atol=1e-6)


@pytest.mark.parametrize(
    ("after", "misses", "inliers", "good"),
    [
        ((1.15, 1, 1), 0, 440, False),  # three quarters of 600 are needed
        ((1.15, 1, 1), 0, 460, True),
        ((1.15, 1, 1), 1, 440, True),  # found again: the view may be another one
        ((1.09, 1, 1), 0, 160, True),  # near: the usual share is enough
    ],
)
def test_check_pose_refuses_a_far_motion_that_loses_inliers(launch, session, after, misses, inliers, good):
    state = state_of(
        pose_at(after), previous=pose_at((1, 1, 1))[:3].ravel(), squared_error=0.01, inliers=inliers,
        misses=misses, last_inliers=0.6,
    )  # fmt: skip
    check_pose(launch, session, state)
    assert bool(state["tracked"]) == good
    assert state["last_inliers"] == pytest.approx(inliers / 1000 if good else 0.6)
