"""Golden vectors are enough to check an executor: replayed here, they give what they say."""

from __future__ import annotations

import gzip
import json
from typing import Any

import numpy as np
import pytest

from slam.devices.choice import choose_device, open_session
from slam.devices.layout import Layout
from slam.kfusion import vectors
from slam.kfusion.declarations import ADAPTIVE_KERNELS, VIEW_KERNELS, kernels_of
from slam.kfusion.definition import VECTORS
from slam.plans.plan import Plan

NEARLY_ALL = 0.999  # at an edge one device decides otherwise than another


def assert_alike(found: np.ndarray, expected: np.ndarray, where: str) -> None:
    """Two buffers hold the same, to rounding; the state in each of its members."""
    if expected.dtype.names:
        for name in expected.dtype.names:
            np.testing.assert_allclose(found[name], expected[name], rtol=1e-3, atol=1e-5, err_msg=where)
    else:
        alike = np.isclose(found.astype(float), expected.astype(float), rtol=1e-3, atol=1e-5, equal_nan=True)
        assert alike.mean() >= NEARLY_ALL, where


@pytest.mark.slow
def test_the_vectors_that_ship_are_those_of_every_kernel_as_it_is_now() -> None:
    session = open_session(choose_device(), Layout("pixels"))
    every = (*kernels_of(session.layout), *ADAPTIVE_KERNELS, *VIEW_KERNELS)
    known = {kernel.name: kernel for kernel in every}
    documents: list[dict[str, Any]] = json.loads(gzip.decompress(VECTORS.read_bytes()))
    replayed = set()

    for document in documents:
        plan = Plan.from_dict(document["plan"])
        name = plan.dispatches[0].kernel
        inputs = vectors.decoded(document["inputs"], plan)
        outputs = vectors.launch(plan, known[name], inputs, session)
        for buffer, expected in vectors.decoded(document["outputs"], plan).items():
            assert_alike(outputs[buffer], expected, f"{name}: {buffer}")
        replayed.add(name)

    assert replayed == set(known)
