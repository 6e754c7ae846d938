"""The kernels over images give what their NumPy references give, on every device present."""

from __future__ import annotations

import numpy as np
import pytest

from slam.dense import reference
from slam.dense.images import SOURCE, intrinsics
from tests.slam.dense.scenes import CAMERA, MIRRORED, image, room_depth


@pytest.mark.parametrize(("ratio", "nearest", "farthest"), [(1, 0, 65535), (2, 1000, 7000), (5, 0, 65535)])
def test_millimetres_to_metres(launch, ratio, nearest, farthest):
    depth = np.random.default_rng(1).integers(0, 9000, (30, 40), dtype=np.uint16)
    expected = reference.millimetres_to_metres(depth, ratio, nearest, farthest)
    metres = np.zeros(expected.shape, np.float32)
    size = metres.shape[::-1]
    launch(
        SOURCE, "millimetres_to_metres", ("image", *size), depth, 40, ratio, nearest, farthest,
        metres, *size,
    )  # fmt: skip
    np.testing.assert_allclose(metres, expected, rtol=1e-6)


@pytest.mark.parametrize("shape", [(30, 40), (7, 5), (3, 3), (2, 1)])
def test_bilateral_filter(launch, shape):
    depth = np.random.default_rng(2).uniform(0.4, 0.9, shape).astype(np.float32)
    depth[np.random.default_rng(3).random(shape) < 0.2] = 0
    filtered, size = np.zeros_like(depth), shape[::-1]
    launch(
        SOURCE, "bilateral_filter", ("image", *size), depth, filtered, *size,
        0.5 / 4.0**2, 0.5 / 0.1**2,
    )  # fmt: skip
    expected = reference.bilateral_filter(depth.astype(float), 2, 4.0, 0.1)
    np.testing.assert_allclose(filtered, expected, rtol=3e-5)
    launch(
        SOURCE, "wide_bilateral_filter", ("image", *size), depth, filtered, *size, 3,
        0.5 / 4.0**2, 0.5 / 0.1**2,
    )  # fmt: skip
    expected = reference.bilateral_filter(depth.astype(float), 3, 4.0, 0.1)
    np.testing.assert_allclose(filtered, expected, rtol=3e-5)


def test_half_sample_of_an_odd_size(launch):
    fine = np.random.default_rng(4).choice([0, 0.8, 1.0, 1.05, 1.4], (31, 41)).astype(np.float32)
    coarse = np.zeros((15, 20), np.float32)
    launch(SOURCE, "half_sample", ("image", 20, 15), fine, 41, coarse, 20, 15, 0.3)
    np.testing.assert_allclose(coarse, reference.half_sample(fine.astype(float), 0.3), rtol=1e-6)


@pytest.mark.parametrize("camera", [CAMERA, MIRRORED], ids=["plain", "mirrored"])
def test_normal_map(launch, camera):
    depth = room_depth(camera)
    maps = [np.full(depth.shape, 7, np.float32) for _ in range(3)]
    launch(
        SOURCE, "normal_map", image(camera), depth, *maps, camera.width, camera.height,
        intrinsics(camera),
    )  # fmt: skip
    expected = reference.normal_map(depth.astype(float), camera)
    np.testing.assert_allclose(np.dstack(maps), expected, atol=2e-4)
    facing = np.sum(expected * reference.vertex_map(depth.astype(float), camera), axis=-1)
    assert (facing <= 0).all()
    assert (facing < 0).sum() > 500
