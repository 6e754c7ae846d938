"""InputFrame images and pyramids hold what their references say, on every device present."""

from __future__ import annotations

from dataclasses import astuple, replace

import numpy as np
import pytest

from slam.camera import Camera
from slam.devices.opencl import Session
from slam.elasticfusion import preprocessing
from slam.elasticfusion.preprocessing import InputFrame
from slam.elasticfusion.tracking import pyramid
from slam.elasticfusion.tracking.pyramid import Pyramid
from tests.slam.dense.scenes import planes
from tests.slam.elasticfusion.relief import levels_of, look, moved, upload
from tests.slam.numpy_kernels import odometry as reference
from tests.slam.numpy_kernels.dense import bilateral_filter_line, millimetres_to_metres, normal_map

SMALL = Camera(30.0, 31.0, 19.3, 14.6, 41, 31)


def download(session: Session, buffer: object, camera: Camera, dtype: type = np.float32) -> np.ndarray:
    image = np.empty((camera.height, camera.width), dtype)
    session.download(buffer, image)
    return image


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1, 2, 3])
def test_a_live_image_is_filtered_within_the_range_that_is_believed(session, ratio):
    random = np.random.default_rng(1)
    sensor = Camera(*(ratio * value for value in astuple(SMALL)))
    depth = random.integers(900, 1000, (sensor.height, sensor.width)).astype(np.uint16)
    depth[:6, :9], depth[6, 12], depth[20:, 30:] = 299, 0, 1201
    colour = random.integers(0, 2, (*depth.shape, 3)).astype(np.uint8)
    live = InputFrame(session, sensor, 1.2, ratio)
    live.take(depth, colour)
    raw = millimetres_to_metres(depth, ratio, 300, 1200)
    filter_ = (preprocessing.RADIUS, preprocessing.SPATIAL_SIGMA, preprocessing.RANGE_SIGMA)
    filtered = bilateral_filter_line(bilateral_filter_line(raw, False, *filter_), True, *filter_)
    np.testing.assert_allclose(download(session, live.image.depth, SMALL), raw, rtol=1e-6)
    np.testing.assert_allclose(download(session, live.filtered, SMALL), filtered, rtol=3e-5)
    normals = np.dstack([download(session, plane, SMALL) for plane in live.image.normals])
    np.testing.assert_allclose(normals, normal_map(filtered, SMALL), atol=2e-2)
    packed = download(session, live.image.colour, SMALL, np.uint32)
    np.testing.assert_array_equal(packed, reference.pack_colour(colour, ratio))
    assert (colour[::ratio, ::ratio].sum(axis=-1) == 0).any()
    assert (packed > 0).all()


def test_kernels_of_a_level_with_holes(launch):
    random = np.random.default_rng(2)
    height, width = 31, 41
    brightness = random.uniform(1, 255, (height, width)).astype(np.float32)
    brightness[random.random((height, width)) < 0.2] = 0
    brightness[:6, :6] = 0
    coarse = np.full((15, 20), 7, np.float32)
    launch(
        pyramid.SOURCE, "half_sample_intensity", ("image", 20, 15), brightness, width, height, coarse, 20, 15
    )
    np.testing.assert_allclose(coarse, reference.half_sample_intensity(brightness), rtol=1e-5)
    assert coarse[0, 0] == 0

    across, down = np.full((2, height, width), 7, np.float32)
    launch(pyramid.SOURCE, "gradient", ("image", width, height), brightness, across, down, width, height)
    expected = reference.gradient(brightness.astype(float))
    np.testing.assert_allclose(across, expected[0], atol=2e-4)
    np.testing.assert_allclose(down, expected[1], atol=2e-4)

    depth = random.choice([0, 1.0, 1.05, 1.4], (height, width)).astype(np.float32)
    normals = random.normal(size=(height, width, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[random.random((height, width)) < 0.3] = 0
    maps = [np.full((15, 20), 7, np.float32) for _ in range(3)]
    launch(
        pyramid.SOURCE, "half_sample_normals", ("image", 20, 15), depth, *planes(normals), width, *maps, 20,
        15, 0.09,
    )  # fmt: skip
    expected = reference.half_sample_normals(depth.astype(float), normals, 0.09)
    np.testing.assert_allclose(np.dstack(maps), expected, atol=1e-4)


def test_the_slope_of_a_ramp_is_its_own_at_every_level(session):
    """Levels lie over each other as their cameras say: a ramp in the image has the same brightness there."""
    y, x = np.mgrid[:60, :80]
    seen = replace(look(np.eye(4)), colour=((2 * x + y + 5) * 0x010101).astype(np.uint32))
    ramps = Pyramid(session, upload(session, seen))
    ramps.build()
    for size, level in enumerate(ramps.levels):
        brightness = download(session, level.intensity, level.camera)[2:-2, 2:-2]
        y, x = np.mgrid[2 : level.camera.height - 2, 2 : level.camera.width - 2]
        fine_x, fine_y = 2**size * (x + 0.5) - 0.5, 2**size * (y + 0.5) - 0.5
        np.testing.assert_allclose(brightness, 2 * fine_x + fine_y + 5, rtol=1e-4)
        slopes = [download(session, image, level.camera) for image in (level.gradient_x, level.gradient_y)]
        np.testing.assert_allclose(slopes[0][3:-3, 3:-3], 2 * 2**size, rtol=1e-3)
        np.testing.assert_allclose(slopes[1][3:-3, 3:-3], 2**size, rtol=1e-3)


@pytest.mark.slow
def test_a_pyramid_is_what_the_references_make_of_the_image(session):
    seen = look(moved(0.1, 0, 0, 0, 0.05, 0), holes=3)
    built = Pyramid(session, upload(session, seen))
    built.build()
    for level, expected in zip(built.levels, levels_of(seen, 3, pyramid.HALF_SAMPLE_RANGE), strict=True):
        for name in ("depth", "intensity", "gradient_x", "gradient_y"):
            got = download(session, getattr(level, name), level.camera)
            np.testing.assert_allclose(got, getattr(expected, name), rtol=1e-4, atol=2e-3)
        normals = np.dstack([download(session, plane, level.camera) for plane in level.normals])
        np.testing.assert_allclose(normals, expected.normals, atol=2e-4)
