"""KinectFusion's tracking kernels give what their NumPy references give, on every device of every backend."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from slam.dense.images import halved
from slam.devices.layout import SOLVERS, SUMS
from slam.kfusion.declarations import MEMBERS, WHILE_ITERATING, WHILE_RETRYING
from slam.kfusion.refusals import Refusal
from tests.slam.conformance.values import ADAPTIVE, camera_of, pose_at, state_of
from tests.slam.dense.scenes import CAMERA, MIRRORED, room_depth
from tests.slam.numpy_kernels import kfusion as reference
from tests.slam.numpy_kernels.dense import exponential, half_sample, normal_map, vertex_map

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
        "view": reference.view_from(model_pose, model_camera),
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


def solve(launch, session, records, threshold, state, conditional: int = 0, prior: float = 0.02) -> None:
    launch(
        "solve", session.layout.one_group(SOLVERS), records=records, count=len(records), threshold=threshold,
        prior=prior, conditional=conditional, state=state,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("conditional", [0, 1])
def test_track_sums_the_normal_equations(launch, session, conditional):
    problem, camera = tracking_problem(), halved(CAMERA)
    state = state_of(problem["pose"], view=problem["view"].ravel(), iterating=1)
    sums = track(launch, session, problem, state, conditional)
    matrix, right_side, squared_error, inliers, overlap = reference.track(
        problem["depth"], problem["normals"], camera, problem["model_vertices"], problem["model_normals"],
        problem["pose"], problem["view"], 0.1, 0.8,
    )  # fmt: skip
    total = sums.sum(axis=0, dtype=float)
    assert inliers > 100
    assert abs(total[28] - inliers) <= 1  # one pixel may fall on the other side of a threshold
    assert abs(total[29] - overlap) <= 1
    assert inliers < overlap < problem["depth"].size
    np.testing.assert_allclose(total[:21], matrix[np.triu_indices(6)], rtol=0.02, atol=0.02 * inliers)
    np.testing.assert_allclose(total[21:27], right_side, rtol=0.02, atol=0.02 * abs(right_side).max())
    assert total[27] == pytest.approx(squared_error, rel=0.02)


@pytest.mark.slow
def test_track_of_a_converged_level_does_nothing(launch, session):
    problem = tracking_problem()
    state = state_of(problem["pose"], view=problem["view"].ravel(), iterating=0)
    sums = track(launch, session, problem, state, conditional=1)
    assert (sums == 5).all()
    solve(launch, session, sums, 1e-5, state, conditional=1)
    np.testing.assert_array_equal(state["pose"], problem["pose"][:3].ravel().astype(np.float32))
    assert state["iterating"] == 0


@pytest.mark.slow
def test_track_trusts_no_index_made_of_nan(launch, session):
    """A pose or a view full of NaN associates nothing, instead of reading somewhere."""
    problem = tracking_problem()
    for poisoned in ("pose", "view"):
        state = state_of(problem["pose"], view=problem["view"].ravel())
        state[poisoned] = np.nan
        sums = track(launch, session, problem, state)
        assert sums[:, 28].sum() == 0


def records_of(matrix: np.ndarray, right_side: np.ndarray, parts: int = 3) -> np.ndarray:
    """Records whose sum says J^T J, J^T e, a squared error of 0.5, 64 inliers and an overlap of 80."""
    shares = np.random.default_rng(7).dirichlet(np.ones(parts))
    record = np.concatenate([matrix[np.triu_indices(6)], right_side, [0.5, 64, 80], np.zeros(2)])
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
    sums = state["squared_error"], state["inliers"], state["overlap"]
    np.testing.assert_allclose(sums, (0.5, 64, 80), rtol=1e-5)
    np.testing.assert_allclose(state["normal_matrix"], matrix[np.triu_indices(6)], rtol=1e-4, atol=1e-3)


def test_solve_keeps_a_camera_that_recovers_near_its_start(launch, session):
    """The prior counts in the first attempt, fades with the misses, and stays out of the normal matrix."""
    jacobians = np.random.default_rng(5).normal(size=(200, 6))
    matrix, right_side = jacobians.T @ jacobians, jacobians.T @ np.full(200, 0.02)
    start, pose = pose_at((1.1, 2.0, 0.4), (0.2, -0.2, 0.1)), pose_at((1.0, 2.0, 0.5), (0.3, -0.2, 0.1))
    for recovering, retrying, misses in [(0, 0, 0), (9, 1, 0), (9, 0, 0), (9, 0, 1)]:
        state = state_of(
            pose, start=start[:3].ravel(), recovering=recovering, retrying=retrying, misses=misses
        )
        solve(launch, session, records_of(matrix, right_side), 0.01, state, prior=2.0)
        equations = matrix, right_side
        if recovering and not retrying:
            equations = reference.add_prior(*equations, 64, 2.0, misses + 1, start, pose)
        expected, _ = reference.solve(*equations, pose, 0.01)
        np.testing.assert_allclose(state["pose"].reshape(3, 4), expected[:3], atol=2e-5)
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


@pytest.mark.parametrize("keeps_view", [False, True])
@pytest.mark.parametrize(("recovering", "misses", "turns"), [(0, 0, 0), (10, 0, 1), (10, 2, 3), (10, 3, 0)])
def test_begin_tracking(launch, session, recovering, misses, turns, keeps_view):
    """A camera that recovers starts where its last turn leads, unless it is lost for too long."""
    pose, turn = pose_at((1.2, 0.4, 0.9), (0.5, -0.7, 0.2)), np.array([0.05, -0.02, 0.04])
    members = ADAPTIVE if keeps_view else MEMBERS
    state = state_of(pose, members, recovering=recovering, misses=misses, turn=turn, retrying=1, view=3.0)
    one = session.layout.one_group(1)
    if keeps_view:
        launch("begin_at_view", one, most_extrapolated=3, state=state)
        expected = np.full((3, 4), 3.0)
    else:
        launch("begin_tracking", one, camera=camera_of(MIRRORED), most_extrapolated=3, state=state)
        expected = reference.view_from(pose, MIRRORED)
    np.testing.assert_array_equal(state["previous"], pose[:3].ravel().astype(np.float32))
    np.testing.assert_allclose(state["view"].reshape(3, 4), expected, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(
        state["pose"].reshape(3, 4), reference.turned(pose, turns * turn)[:3], atol=1e-5
    )
    np.testing.assert_array_equal(state["start"], state["pose"])
    assert state["retrying"] == 0


def test_keep_view(launch, session):
    pose = pose_at((1.2, 0.4, 0.9), (0.5, -0.7, 0.2))
    state = state_of(pose, ADAPTIVE)
    launch("keep_view", session.layout.one_group(1), camera=camera_of(MIRRORED), state=state)
    expected = reference.view_from(pose, MIRRORED)
    np.testing.assert_allclose(state["view"].reshape(3, 4), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    ("refusal", "misses"), [(0, 0), (Refusal.INLIERS, 1), (Refusal.OUTSIDE, 11), (Refusal.RESIDUAL, 16)]
)
def test_begin_retry(launch, session, refusal, misses):
    """The second attempt starts from the kept pose, and around it after ten failed checks."""
    pose = pose_at((1.2, 0.4, 0.9), (0.5, -0.7, 0.2))
    state = state_of(pose, refusal=refusal, misses=misses)
    launch("begin_retry", session.layout.one_group(1), search_after=10, search_angle=0.2, state=state)
    assert bool(state["retrying"]) == (refusal != 0)
    before = misses - 1 if refusal else misses
    assert state["misses"] == before
    expected = reference.begin_retry(pose, before, 10, 0.2)
    # WGSL promises sines to 2^-11.
    np.testing.assert_allclose(state["pose"].reshape(3, 4), expected[:3], atol=1e-4)
    assert np.allclose(expected, pose) == (misses < 11)


LIMITS = reference.Limits(
    pixels=1000, max_residual=0.02, min_inliers=0.15, near_motion=0.1, far_inliers=0.3, kept_inliers=0.75,
    kept_agreement=0.9, max_translation=0.2, max_rotation=0.25, volume_size=SIZE,
)  # fmt: skip
START = (1, 1, 1)


def check_pose(launch, session, state, conditional: int = 0) -> None:
    launch(
        "check_pose", session.layout.one_group(1), **dataclasses.asdict(LIMITS), recovery=10,
        conditional=conditional, state=state,
    )  # fmt: skip


def refusal_of(launch, session, before, after, **values) -> Refusal | None:
    """What the kernel refuses, checked against the reference; it keeps a pose that passes, and no other."""
    state = state_of(after, previous=before[:3].ravel(), **values)
    check_pose(launch, session, state)
    refusal = Refusal(int(state["refusal"])) if state["refusal"] else None
    assert refusal == reference.check_pose(before, after, LIMITS, **values)
    assert bool(state["tracked"]) == (refusal is None)
    np.testing.assert_allclose(state["pose"].reshape(3, 4), (before if refusal else after)[:3], atol=1e-6)
    assert state["misses"] == (values.get("misses", 0) + 1 if refusal else 0)
    recovering = values.get("recovering", 0)
    assert state["recovering"] == (10 if refusal else max(recovering - 1, 0))
    inliers = values["inliers"] / LIMITS.pixels
    assert state["last_inliers"] == pytest.approx(values.get("last_inliers", 0) if refusal else inliers)
    return refusal


@pytest.mark.parametrize(
    ("squared_error", "inliers", "refusal"),
    [
        (0.02, 200, None),
        (0.2, 200, Refusal.RESIDUAL),
        (0.001, 100, Refusal.INLIERS),
        (0.0, 0, Refusal.INLIERS),
        (np.nan, 200, Refusal.RESIDUAL),
    ],
)
def test_check_pose_refuses_a_bad_fit(launch, session, squared_error, inliers, refusal):
    before, after = pose_at(START), pose_at((1.05, 1, 1))
    values = {"squared_error": squared_error, "inliers": inliers, "misses": 2}
    assert refusal_of(launch, session, before, after, **values) == refusal


@pytest.mark.parametrize(
    ("before", "after", "twist", "misses", "refusal"),
    [
        (START, (1.19, 1, 1), (0, 0, 0), 0, None),
        (START, (1.21, 1, 1), (0, 0, 0), 0, Refusal.TRANSLATION),
        (START, (1.21, 1, 1), (0, 0, 0), 1, None),  # twice the time
        (START, (1.05, 1, 1), (0, 0.24, 0), 0, None),
        (START, (1.05, 1, 1), (0, 0.26, 0), 0, Refusal.ROTATION),
        (START, (1.05, 1, 1), (0, 0.26, 0), 1, None),
        (START, (1.05, 1, 1), (0, 3.1, 0), 20, None),  # any rotation, after so long
        ((0.05, 1, 1), (-0.01, 1, 1), (0, 0, 0), 0, Refusal.OUTSIDE),
        ((1, 1, SIZE - 0.05), (1, 1, SIZE + 0.01), (0, 0, 0), 0, Refusal.OUTSIDE),
        ((1, -0.05, 1), (1, -0.06, 1), (0, 0, 0), 0, None),  # it began outside
        (START, (np.nan, 1, 1), (0, 0, 0), 0, Refusal.TRANSLATION),
    ],
)
def test_check_pose_refuses_a_motion_that_is_not_possible(
    launch, session, before, after, twist, misses, refusal
):
    values = {"squared_error": 0.01, "inliers": 400, "misses": misses}
    assert refusal_of(launch, session, pose_at(before), pose_at(after, twist), **values) == refusal


@pytest.mark.parametrize(
    ("after", "twist", "inliers", "last_inliers", "good"),
    [
        ((1.15, 1, 1), (0, 0, 0), 290, 0, False),  # beyond the distance of association
        ((1.15, 1, 1), (0, 0, 0), 310, 0, True),
        ((1.06, 1, 1), (0, 0.06, 0), 290, 0, False),
        ((1.15, 1, 1), (0, 0, 0), 440, 0.6, False),  # three quarters of 600 are needed
        ((1.15, 1, 1), (0, 0, 0), 460, 0.6, True),
        ((1.09, 1, 1), (0, 0, 0), 160, 0.6, True),  # near: the usual share is enough
    ],
)
def test_check_pose_refuses_a_far_motion_that_loses_inliers(
    launch, session, after, twist, inliers, last_inliers, good
):
    values = {"squared_error": 0.01, "inliers": inliers, "last_inliers": last_inliers}
    refusal = refusal_of(launch, session, pose_at(START), pose_at(after, twist), **values)
    assert refusal == (None if good else Refusal.FAR_MOTION)


@pytest.mark.parametrize(
    ("inliers", "overlap", "retrying", "good"),
    [
        (200, 300, 0, True),  # the view may be another one
        (200, 400, 0, False),  # what sees the model must agree with it
        (200, 300, 1, False),  # without a prior many pixels must
        (310, 450, 1, True),
        (310, 600, 1, False),
        (140, 150, 0, False),
    ],
)
def test_check_pose_asks_a_camera_that_recovers_for_agreement(
    launch, session, inliers, overlap, retrying, good
):
    values = {
        "squared_error": 0.01, "inliers": inliers, "overlap": overlap, "recovering": 7,
        "retrying": retrying, "last_inliers": 0.6, "last_agreement": 0.7,
    }  # fmt: skip
    assert (refusal_of(launch, session, pose_at(START), pose_at((1.15, 1, 1)), **values) is None) == good


def test_check_pose_keeps_the_turn_of_one_check(launch, session):
    """After two missed checks a third of the turn is that of one."""
    before, after = pose_at(START, (0.3, 0.1, -0.2)), pose_at((1.15, 1, 1), (0.1, 0.4, -0.1))
    state = state_of(after, previous=before[:3].ravel(), squared_error=0.01, inliers=500, misses=2)
    check_pose(launch, session, state)
    turn = reference.rotation_between(before, after)
    np.testing.assert_allclose(state["turn"], turn / 3, atol=1e-5)
    assert state["rotation"] == pytest.approx(np.linalg.norm(turn), abs=1e-5)
    assert state["translation"] == pytest.approx(0.15, abs=1e-6)


def test_nothing_is_retried_unless_the_first_attempt_failed(launch, session):
    """The kernels of the second attempt return at once, whatever `iterating` says."""
    problem = tracking_problem()
    state = state_of(problem["pose"], view=problem["view"].ravel(), iterating=1, retrying=0)
    before = state.copy()
    for conditional in (WHILE_RETRYING, WHILE_RETRYING | WHILE_ITERATING):
        sums = track(launch, session, problem, state, conditional)
        assert (sums == 5).all()
        solve(launch, session, sums, 1e-5, state, conditional)
    check_pose(launch, session, state, WHILE_RETRYING)
    assert state == before
