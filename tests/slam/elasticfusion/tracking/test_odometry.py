"""Registrations find motions that are known; their kernels give what the NumPy references give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam.camera import Camera
from slam.dense.images import intrinsics
from slam.devices.layout import SUMS
from slam.devices.opencl import Session
from slam.elasticfusion.configuration import ICP_ONLY, REFERENCE_PIXELS
from slam.elasticfusion.tracking.odometry import (
    CORRELATED_PIXELS,
    ESTIMATE,
    LEAST_DEPTH_NOISE,
    RGB_WEIGHT,
    SOURCE,
    Odometry,
    Registration,
    pose_deviations,
    residual_variance,
)
from slam.elasticfusion.tracking.pyramid import Pyramid
from tests.slam.dense.scenes import planes
from tests.slam.elasticfusion.relief import CAMERA, Seen, levels_of, look, moved, upload
from tests.slam.numpy_kernels import odometry as reference
from tests.slam.numpy_kernels.dense import exponential, solve_symmetric

MOTION = moved(0.02, -0.015, 0.01, 0.006, -0.01, 0.008)  # from the source's camera to the target's
HALF = Camera(40.0, 40.5, 19.4, 14.95, 40, 30)  # CAMERA's view at half its size


def register(
    session: Session,
    source: Seen,
    target: Seen,
    weight: float,
    start: np.ndarray | None = None,
    **options: object,
) -> Registration:
    pyramids = [Pyramid(session, upload(session, seen)) for seen in (source, target)]
    for pyramid in pyramids:
        pyramid.build()
    return Odometry(session, *pyramids, weight, **options).register(np.eye(4) if start is None else start)


def off(pose: np.ndarray, truth: np.ndarray = MOTION) -> tuple[float, float]:
    """Millimetres and degrees between two poses."""
    difference = np.linalg.inv(truth) @ pose
    cosine = np.clip((np.trace(difference[:3, :3]) - 1) / 2, -1, 1)
    return 1000 * float(np.linalg.norm(difference[:3, 3])), float(np.degrees(np.arccos(cosine)))


def arguments(level: reference.Level) -> list[object]:
    images = [level.depth, *planes(level.normals), level.intensity, level.gradient_x, level.gradient_y]
    return [
        *(np.asarray(image, np.float32) for image in images),
        level.camera.width, level.camera.height, intrinsics(level.camera),
    ]  # fmt: skip


@pytest.mark.slow
def test_listed_are_the_steep_pixels_with_a_depth(launch):
    (level,) = levels_of(look(np.eye(4), holes=1), 1, 0.09)
    columns, counts = np.full((60, 80), -1, np.int32), np.full(60, -1, np.int32)
    launch(
        SOURCE, "list_steep_pixels", (60,), *(np.float32(i) for i in (level.depth, level.gradient_x)),
        np.float32(level.gradient_y), 80, 5.0, 2.05, columns, counts,
    )  # fmt: skip
    expected = reference.list_steep_pixels(level, 5.0, 2.05)
    assert 500 < sum(map(len, expected)) < 3500
    assert [[int(x) for x in row[:count]] for row, count in zip(columns, counts, strict=True)] == expected


@pytest.mark.slow
@pytest.mark.parametrize("weights", [(10.0, 0.05), (0.0, 1.0), (1.0, 0.0)], ids=["both", "colour", "depth"])
def test_equations_and_the_pose_they_lead_to(launch, session, weights):
    (source,) = levels_of(look(MOTION, HALF, holes=1), 1, 0.09)
    (target,) = levels_of(look(np.eye(4), HALF, holes=2), 1, 0.09)
    pose = moved(0.015, -0.01, 0.01, 0.004, -0.005, 0.002)
    listed = reference.list_steep_pixels(source, 5.0, 6.0)
    columns, counts = np.zeros((30, 40), np.int32), np.array([len(row) for row in listed], np.int32)
    for row, steep in zip(columns, listed, strict=True):
        row[: len(steep)] = steep
    estimate = np.zeros(1, ESTIMATE)
    estimate["pose"], estimate["noise"] = pose[:3].ravel(), 4.0
    count, size, group = session.layout.sums(40, 30)
    records = np.full((count, SUMS), 5, np.float32)
    launch(
        SOURCE, "equations", size, *arguments(source), *arguments(target), columns, counts, *weights, 0.1,
        0.94, 0.07, 0, estimate, records, group=group,
    )  # fmt: skip
    expected = reference.equations(source, target, listed, pose, *weights, 4.0, 0.1, 0.94, 0.07)
    total = records.sum(axis=0, dtype=float)
    assert (expected.icp_inliers > 400) == (weights[0] > 0)
    assert (expected.rgb_inliers > 300) == (weights[1] > 0)
    assert abs(total[28] - expected.icp_inliers) <= 1  # one may fall on the other side of a threshold
    assert abs(total[30] - expected.rgb_inliers) <= 1
    matrix, right_side = expected.matrix[np.triu_indices(6)], expected.right_side
    np.testing.assert_allclose(total[:21], matrix, rtol=0.02, atol=0.005 * abs(matrix).max())
    np.testing.assert_allclose(total[21:27], right_side, rtol=0.02, atol=0.01 * abs(right_side).max())
    np.testing.assert_allclose(total[27], expected.icp_squared_error, rtol=0.02)
    np.testing.assert_allclose(total[29], expected.rgb_squared_error, rtol=0.02)

    launch(SOURCE, "solve", (1,), records, count, 1e-9, 0, estimate)
    update = exponential(solve_symmetric(expected.matrix, expected.right_side)) @ pose
    np.testing.assert_allclose(estimate["pose"][0].reshape(3, 4), update[:3], atol=5e-4)
    assert estimate["noise"][0] == pytest.approx(reference.measure_noise(expected), rel=0.02)
    assert estimate["converged"][0] == 0
    estimate["noise"] = 0
    launch(SOURCE, "measure_noise", (1,), records, count, estimate)
    assert estimate["noise"][0] == pytest.approx(reference.measure_noise(expected), rel=0.02)


def test_a_level_that_has_converged_does_nothing(launch, session):
    (level,) = levels_of(look(np.eye(4), HALF), 1, 0.09)
    estimate = np.zeros(1, ESTIMATE)
    estimate["pose"], estimate["converged"] = MOTION[:3].ravel(), 1
    count, size, group = session.layout.sums(40, 30)
    records = np.full((count, SUMS), 5, np.float32)
    launch(
        SOURCE, "equations", size, *arguments(level), *arguments(level), np.zeros((30, 40), np.int32),
        np.zeros(30, np.int32), 10.0, 0.0, 0.1, 0.94, 0.07, 1, estimate, records, group=group,
    )  # fmt: skip
    launch(SOURCE, "solve", (1,), records, count, 1e-9, 1, estimate)
    assert (records == 5).all()
    np.testing.assert_array_equal(estimate["pose"][0], MOTION[:3].ravel().astype(np.float32))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("weight", "millimetres", "degrees"), [(0.0, 1.5, 0.05), (10.0, 0.5, 0.02), (ICP_ONLY, 1.0, 0.03)]
)
def test_a_motion_is_found_by_colour_by_depth_and_by_both(session, weight, millimetres, degrees):
    registration = register(session, look(MOTION), look(np.eye(4)), weight)
    distance, angle = off(registration.pose)
    assert distance < millimetres
    assert angle < degrees
    assert (registration.icp_inliers > 0.7 * 640 * 480) == (weight > 0)
    assert (registration.rgb_inliers > 0.1 * 640 * 480) == (weight < ICP_ONLY)
    assert registration.is_certain(0.005)
    assert np.linalg.det(registration.pose[:3, :3]) == pytest.approx(1, abs=1e-12)


@pytest.mark.slow
def test_on_a_flat_wall_only_its_paint_shows_how_far_one_slid(session):
    slide = moved(0.03, -0.02, 0, 0, 0, 0)
    source, target = look(slide, relief=0), look(np.eye(4), relief=0)
    depth_alone = register(session, source, target, ICP_ONLY)
    together = register(session, source, target, 10.0)
    assert off(depth_alone.pose, slide)[0] > 20
    assert np.isinf([depth_alone.position_deviation, depth_alone.rotation_deviation]).all()
    assert not depth_alone.is_certain(1e9)
    assert off(together.pose, slide)[0] < 1
    assert together.is_certain(0.02)
    unpainted = register(
        session, look(slide, relief=0, contrast=0), look(np.eye(4), relief=0, contrast=0), 10.0
    )
    assert off(unpainted.pose, slide)[0] > 20
    assert unpainted.rgb_inliers == 0


@pytest.mark.slow
def test_each_extreme_weight_leaves_one_error_out(session):
    source, target = look(MOTION), look(np.eye(4))
    repainted = replace(source, colour=source.colour[::-1].copy())
    bare = replace(source, normals=np.zeros_like(source.normals))
    by_depth = [register(session, seen, target, ICP_ONLY).pose for seen in (source, repainted)]
    np.testing.assert_array_equal(*by_depth)
    by_colour = [register(session, seen, target, 0.0).pose for seen in (source, bare)]
    np.testing.assert_array_equal(*by_colour)
    assert off(register(session, repainted, target, 10.0).pose)[0] > off(by_depth[0])[0]


@pytest.mark.slow
def test_a_larger_weight_believes_the_depth_more(session):
    """The paint has moved on the relief: colour says one thing, depth another."""
    source, target = look(MOTION), look(np.eye(4))
    misled = replace(source, colour=target.colour)
    errors = [off(register(session, misled, target, weight).pose)[0] for weight in (0.5, 10.0, 50.0)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


@pytest.mark.slow
def test_fast_odometry_compares_colours_at_the_finest_level_alone(session):
    slide = moved(0.03, -0.02, 0, 0, 0, 0)
    source, target = look(slide, relief=0), look(np.eye(4), relief=0)
    registrations = {
        (fast, rounds): register(session, source, target, 10.0, iterations=(rounds, 5, 4), fast=fast)
        for fast in (False, True)
        for rounds in (0, 10)
    }
    distance = {key: off(registration.pose, slide)[0] for key, registration in registrations.items()}
    assert distance[False, 0] < 3
    assert distance[True, 0] > 20
    assert registrations[True, 0].rgb_inliers == 0
    assert max(distance[False, 10], distance[True, 10]) < 1


def test_one_level_is_enough_for_small_motions(session):
    small = moved(0.005, 0.003, 0, 0, 0.002, 0)
    pyramids = [Pyramid(session, upload(session, look(pose)), 1) for pose in (small, np.eye(4))]
    for pyramid in pyramids:
        pyramid.build()
    registration = Odometry(session, *pyramids, ICP_ONLY, iterations=(10,)).register(np.eye(4))
    assert off(registration.pose, small)[0] < 1


def test_measures_of_quality_do_not_depend_on_the_size_of_the_image(session):
    random = np.random.default_rng(4)
    registrations = []
    for camera in (HALF, CAMERA):
        source = look(MOTION, camera)
        noisy = replace(source, depth=source.depth + random.normal(0, 0.002, source.depth.shape))
        registrations.append(register(session, noisy, look(np.eye(4), camera), ICP_ONLY))
    small, large = registrations
    assert small.icp_inliers == pytest.approx(large.icp_inliers, rel=0.1)
    assert small.icp_error == pytest.approx(large.icp_error, rel=0.15)
    assert small.position_deviation == pytest.approx(large.position_deviation, rel=0.15)
    assert small.rotation_deviation == pytest.approx(large.rotation_deviation, rel=0.15)


@pytest.mark.slow
def test_where_nothing_is_seen_the_pose_stays_where_it_started(session):
    nothing = Seen(CAMERA, np.zeros((60, 80)), np.zeros((60, 80, 3)), np.zeros((60, 80), np.uint32))
    for source, target in ((nothing, nothing), (look(MOTION), nothing), (nothing, look(MOTION))):
        for weight in (0.0, 10.0, ICP_ONLY):
            registration = register(session, source, target, weight, start=MOTION)
            np.testing.assert_allclose(registration.pose, MOTION, atol=1e-6)
            assert registration.icp_error == float("inf")
            assert registration.icp_inliers == registration.rgb_inliers == 0
            assert np.isinf([registration.position_deviation, registration.rotation_deviation]).all()


def test_an_overflow_gives_the_start_pose_without_inliers(session):
    sharp, steep = (replace(seen, normals=1e25 * seen.normals) for seen in (look(MOTION), look(np.eye(4))))
    registration = register(session, sharp, steep, ICP_ONLY, start=MOTION)
    np.testing.assert_array_equal(registration.pose, MOTION)
    assert registration.icp_error == float("inf")
    assert registration.icp_inliers == registration.rgb_inliers == 0
    assert np.isinf([registration.position_deviation, registration.rotation_deviation]).all()


@pytest.mark.slow
def test_a_registration_is_the_same_every_time(session):
    pyramids = [Pyramid(session, upload(session, look(pose, holes=1))) for pose in (MOTION, np.eye(4))]
    for pyramid in pyramids:
        pyramid.build()
    odometry = Odometry(session, *pyramids, 10.0)
    first, _, third = odometry.register(np.eye(4)), odometry.register(MOTION), odometry.register(np.eye(4))
    np.testing.assert_array_equal(first.pose, third.pose)
    assert first.position_deviation == third.position_deviation
    assert first.icp_error == third.icp_error


def noisy(seen: Seen, seed: int, metres: float) -> Seen:
    random = np.random.default_rng(seed)
    return replace(seen, depth=seen.depth + random.normal(0, metres, seen.depth.shape))


def test_deviations_do_not_depend_on_the_weight_of_depth(session):
    """Without paint depth is all that counts, and its weight only scales the normal equations."""
    bare, target = noisy(look(MOTION, contrast=0), 1, 0.003), look(np.eye(4), contrast=0)
    light, heavy = (register(session, bare, target, weight) for weight in (1.0, 20.0))
    assert light.rgb_inliers == heavy.rgb_inliers == 0
    assert light.position_deviation == pytest.approx(heavy.position_deviation, rel=0.01)
    assert light.rotation_deviation == pytest.approx(heavy.rotation_deviation, rel=0.01)


def test_deviations_are_in_proportion_to_the_noise(session):
    target = look(np.eye(4))
    low, high = (
        register(session, noisy(look(MOTION), 1, metres), target, ICP_ONLY) for metres in (0.003, 0.012)
    )
    assert high.position_deviation == pytest.approx(4 * low.position_deviation, rel=0.2)


@pytest.mark.slow
def test_deviations_are_the_scatter_of_poses_under_noise_times_what_pixels_share(session):
    """The noise here is another in each pixel, so that the scatter is smaller by the root of those that
    count as one.
    """
    source, target = look(MOTION), look(np.eye(4))
    registrations = [register(session, noisy(source, seed, 0.004), target, ICP_ONLY) for seed in range(30)]
    scatter = np.cov(np.array([registration.pose[:3, 3] for registration in registrations]).T)
    pixels = CORRELATED_PIXELS * CAMERA.width * CAMERA.height / REFERENCE_PIXELS
    expected = np.sqrt(pixels * np.linalg.eigvalsh(scatter)[-1])
    assert registrations[0].position_deviation == pytest.approx(expected, rel=0.35)


def test_pose_deviations_are_those_of_the_inverse_normal_matrix():
    rows = np.random.default_rng(5).normal(size=(30, 6))
    matrix = rows.T @ rows
    covariance = 0.04 * np.linalg.inv(matrix)
    position, rotation = pose_deviations(matrix[np.triu_indices(6)], 0.04)
    assert position == pytest.approx(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3]).max()))
    assert rotation == pytest.approx(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:]).max()))
    rows[:, 1] = 0
    kept = [0, 2, 3, 4, 5]
    matrix = rows.T @ rows
    position, rotation = pose_deviations(matrix[np.triu_indices(6)], 0.04)
    covariance = 0.04 * np.linalg.inv(matrix[np.ix_(kept, kept)])
    assert position == np.inf
    assert rotation == pytest.approx(np.sqrt(np.linalg.eigvalsh(covariance[2:, 2:]).max()))
    assert pose_deviations(np.zeros(21), 0.04) == (np.inf, np.inf)


def test_the_variance_of_residuals_has_a_floor_for_depth_and_a_bound_for_brightness():
    assert residual_variance(100 * 0.004**2, 100, 0, 10.0) == pytest.approx(0.04**2)
    assert residual_variance(0, 100, 0, 10.0) == pytest.approx((10 * LEAST_DEPTH_NOISE) ** 2)
    assert residual_variance(0, 0, 100, 0.0) == pytest.approx((RGB_WEIGHT / 2) ** 2)
    assert residual_variance(0, 0, 0, 10.0) == 0
    assert residual_variance(100 * 0.004**2, 100, 50, 10.0) == pytest.approx(0.04**2)
    assert residual_variance(0, 100, 50, 10.0) == pytest.approx((RGB_WEIGHT / 2) ** 2)
    differences = np.random.default_rng(3).laplace(0, 5, 1000)
    weighted = RGB_WEIGHT * differences / (np.sqrt(np.mean(differences**2)) + abs(differences))
    assert 0.5 * (RGB_WEIGHT / 2) ** 2 < np.mean(weighted**2) <= (RGB_WEIGHT / 2) ** 2
