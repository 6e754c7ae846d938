"""The kernels over images give what their NumPy references give, on every device of every backend."""

from __future__ import annotations

import numpy as np
import pytest

from tests.slam.conformance.values import camera_of
from tests.slam.dense.scenes import CAMERA, MIRRORED, room_depth
from tests.slam.numpy_kernels import dense


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "nearest", "farthest"), [(1, 0, 65535), (2, 1000, 7000), (5, 0, 65535)])
@pytest.mark.parametrize("width", [40, 35])
def test_millimetres_to_metres(launch, session, ratio, nearest, farthest, width):
    depth = np.random.default_rng(1).integers(0, 65536, (30, width), dtype=np.uint16)
    depth[::3] //= 8
    expected = dense.millimetres_to_metres(depth, ratio, nearest, farthest)
    metres = np.zeros(expected.shape, np.float32)
    height, width = metres.shape
    launch(
        "millimetres_to_metres", session.layout.over(width, height), millimetres=depth,
        sensor_width=depth.shape[1], ratio=ratio, nearest=nearest, farthest=farthest, metres=metres,
        width=width, height=height,
    )  # fmt: skip
    np.testing.assert_allclose(metres, expected, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(30, 40), (7, 5), (3, 3), (2, 1)])
def test_bilateral_filter(launch, session, shape):
    depth = np.random.default_rng(2).uniform(0.4, 0.9, shape).astype(np.float32)
    depth[np.random.default_rng(3).random(shape) < 0.2] = 0
    filtered, (height, width) = np.full_like(depth, 7), shape
    launch(
        "bilateral_filter", session.layout.over(width, height), depth=depth, filtered=filtered, width=width,
        height=height, spatial_factor=0.5 / 4.0**2, range_factor=0.5 / 0.1**2,
    )  # fmt: skip
    expected = dense.bilateral_filter(depth.astype(float), 2, 4.0, 0.1)
    np.testing.assert_allclose(filtered, expected, rtol=3e-5)


@pytest.mark.slow
def test_half_sample_of_an_odd_size(launch, session):
    fine = np.random.default_rng(4).choice([0, 0.8, 1.0, 1.05, 1.4], (31, 41)).astype(np.float32)
    coarse = np.zeros((15, 20), np.float32)
    launch(
        "half_sample", session.layout.over(20, 15), fine=fine, fine_width=41, coarse=coarse, width=20,
        height=15, range=0.3,
    )  # fmt: skip
    np.testing.assert_allclose(coarse, dense.half_sample(fine.astype(float), 0.3), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, MIRRORED], ids=["plain", "mirrored"])
def test_normal_map(launch, session, camera):
    depth = room_depth(camera)
    normals = np.full((3, *depth.shape), 7, np.float32)
    launch(
        "normal_map", session.layout.over(camera.width, camera.height), depth=depth, normals=normals,
        width=camera.width, height=camera.height, camera=camera_of(camera),
    )  # fmt: skip
    expected = dense.normal_map(depth.astype(float), camera)
    np.testing.assert_allclose(np.moveaxis(normals, 0, -1), expected, atol=2e-4)
    facing = np.sum(expected * dense.vertex_map(depth.astype(float), camera), axis=-1)
    assert (facing <= 0).all()
    assert (facing < 0).sum() > 500
