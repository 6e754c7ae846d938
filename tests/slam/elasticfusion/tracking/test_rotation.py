"""A turn of the camera is found from brightness alone, as the NumPy reference finds it."""

from __future__ import annotations

import numpy as np
import pytest

from slam.dense.images import intrinsics
from slam.devices.layout import SUMS
from slam.elasticfusion.tracking.pyramid import Pyramid
from slam.elasticfusion.tracking.rotation import ALIGNMENT, SOURCE, RotationAlignment
from tests.slam.elasticfusion.relief import CAMERA, Seen, levels_of, look, moved, upload
from tests.slam.numpy_kernels import odometry as reference
from tests.slam.numpy_kernels.dense import exponential, solve_symmetric

TURN = moved(0, 0, 0, 0.03, -0.05, 0.02)


def images(level: reference.Level) -> list[np.ndarray]:
    return [np.float32(image) for image in (level.intensity, level.gradient_x, level.gradient_y)]


@pytest.mark.slow
def test_turn_equations_and_the_turn_they_lead_to(launch, session):
    present, earlier = (levels_of(look(pose, holes=1), 2, 0.09)[1] for pose in (TURN, np.eye(4)))
    start = moved(0, 0, 0, 0.01, -0.02, 0)
    alignment = np.zeros(1, ALIGNMENT)
    alignment["pose"] = start[:3].ravel()
    count, size, group = session.layout.sums(40, 30)
    records = np.full((count, SUMS), 5, np.float32)
    launch(
        SOURCE, "so3_linearise", size, *images(present), *images(earlier), 40, 30,
        intrinsics(present.camera), alignment, records, group=group,
    )  # fmt: skip
    matrix, right_side, squared_error, inliers = reference.so3_linearise(present, earlier, start[:3, :3])
    total = records.sum(axis=0, dtype=float)
    assert inliers > 800
    assert abs(total[28] - inliers) <= 1
    np.testing.assert_allclose(total[[15, 16, 17, 18, 19, 20]], matrix[np.triu_indices(3)], rtol=0.01)
    np.testing.assert_allclose(total[24:27], right_side, rtol=0.02, atol=0.01 * abs(right_side).max())
    assert total[27] == pytest.approx(squared_error, rel=0.01)

    update = reference.turn(matrix, right_side, squared_error, inliers, np.inf, 0)
    expected = exponential(np.concatenate([np.zeros(3), update])) @ start
    launch(SOURCE, "turn", (1,), records, count, 0.5, alignment)
    np.testing.assert_allclose(alignment["pose"][0].reshape(3, 4), expected[:3], atol=1e-3)
    np.testing.assert_allclose(alignment["best"][0].reshape(3, 4), start[:3], atol=1e-6)
    assert alignment["error"][0] == pytest.approx(squared_error / inliers, rel=0.01)
    moved_on = alignment["pose"][0].copy()

    # The same error again is not better: it ends, and keeps the best.
    launch(SOURCE, "turn", (1,), records, count, 0.5, alignment)
    assert reference.turn(matrix, right_side, squared_error, inliers, squared_error / inliers, 0) is None
    assert alignment["ended"][0] == 1
    np.testing.assert_array_equal(alignment["pose"][0], moved_on)
    np.testing.assert_allclose(alignment["best"][0].reshape(3, 4), start[:3], atol=1e-6)


def test_less_error_over_less_than_half_the_pixels_is_no_better(launch):
    alignment = np.zeros(1, ALIGNMENT)
    alignment["pose"] = alignment["best"] = np.eye(4)[:3].ravel()
    alignment["error"], alignment["overlap"] = 9.0, 1000
    records = np.zeros((1, SUMS), np.float32)
    records[0, 15:21], records[0, 27], records[0, 28] = [9, 0, 0, 9, 0, 9], 400, 400
    launch(SOURCE, "turn", (1,), records, 1, 0.5, alignment)
    assert alignment["ended"][0] == 1
    assert reference.turn(np.eye(3), np.ones(3), 400.0, 400, 9.0, 500) is None
    np.testing.assert_allclose(reference.turn(9 * np.eye(3), np.ones(3), 600.0, 600, 9.0, 500), 1 / 9)
    np.testing.assert_allclose(solve_symmetric(np.zeros((3, 3)), np.ones(3)), 0)


def test_a_turn_since_the_remembered_frame_is_found(session):
    image = upload(session, look(np.eye(4)))
    live = Pyramid(session, image, 2)
    alignment = RotationAlignment(session, live)
    live.build()
    alignment.remember()
    np.testing.assert_allclose(alignment.align(), np.eye(3), atol=1e-4)
    upload(session, look(TURN), image)
    live.build()
    left = exponential(np.zeros(6))
    left[:3, :3] = alignment.align() @ TURN[:3, :3].T
    angle = np.degrees(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1, 1)))
    assert angle < 0.15  # of 3.5
    alignment.remember()
    np.testing.assert_allclose(alignment.align(), np.eye(3), atol=1e-4)


def test_without_brightness_there_is_no_turn(session):
    nothing = Seen(CAMERA, np.zeros((60, 80)), np.zeros((60, 80, 3)), np.zeros((60, 80), np.uint32))
    image = upload(session, nothing)
    live = Pyramid(session, image)
    alignment = RotationAlignment(session, live)
    live.build()
    alignment.remember()
    upload(session, look(TURN), image)
    live.build()
    np.testing.assert_array_equal(alignment.align(), np.eye(3))
