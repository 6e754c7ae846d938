"""The bilateral filter along a line gives what its NumPy reference gives, on every OpenCL device.

`tests/slam/conformance` has the other kernels over images.
"""

from __future__ import annotations

import numpy as np
import pytest

from slam.dense.images import SOURCE
from tests.slam.numpy_kernels import dense


@pytest.mark.slow
@pytest.mark.parametrize("down", [0, 1])
@pytest.mark.parametrize("shape", [(30, 40), (7, 5), (3, 3), (2, 1)])
def test_bilateral_filter_line(launch, shape, down):
    depth = np.random.default_rng(2).uniform(0.4, 0.9, shape).astype(np.float32)
    depth[np.random.default_rng(3).random(shape) < 0.2] = 0
    filtered, size = np.zeros_like(depth), shape[::-1]
    launch(
        SOURCE, "bilateral_filter_line", ("image", *size), depth, filtered, *size, down, 3,
        0.5 / 4.0**2, 0.5 / 0.1**2,
    )  # fmt: skip
    expected = dense.bilateral_filter_line(depth.astype(float), bool(down), 3, 4.0, 0.1)
    np.testing.assert_allclose(filtered, expected, rtol=3e-5)
