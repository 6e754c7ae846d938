"""The wide bilateral filter gives what its NumPy reference gives, on every OpenCL device.

`tests/slam/conformance` has the other kernels over images.
"""

from __future__ import annotations

import numpy as np
import pytest

from slam.dense.images import SOURCE
from tests.slam.reference import dense


@pytest.mark.parametrize("shape", [(30, 40), (7, 5), (3, 3), (2, 1)])
def test_wide_bilateral_filter(launch, shape):
    depth = np.random.default_rng(2).uniform(0.4, 0.9, shape).astype(np.float32)
    depth[np.random.default_rng(3).random(shape) < 0.2] = 0
    filtered, size = np.zeros_like(depth), shape[::-1]
    launch(
        SOURCE, "wide_bilateral_filter", ("image", *size), depth, filtered, *size, 3,
        0.5 / 4.0**2, 0.5 / 0.1**2,
    )  # fmt: skip
    expected = dense.bilateral_filter(depth.astype(float), 3, 4.0, 0.1)
    np.testing.assert_allclose(filtered, expected, rtol=3e-5)
