"""Nodes sampled from the map, the map deformed with them, and surfels that become active again."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from slam.elasticfusion.loops.deformer import MapDeformer
from slam.elasticfusion.loops.graph import Deformation, Graph
from slam.elasticfusion.mapping.surfels import Surfels
from tests.slam.elasticfusion.maps import (
    CAMERA,
    START,
    THRESHOLD,
    first_map,
    many_surfels,
    scene,
    uploaded,
    written,
)
from tests.slam.numpy_kernels import fusion as reference
from tests.slam.numpy_kernels.dense import exponential


def bent_graph(nodes: Graph) -> Deformation:
    """Each node turned and moved a little, and not quite rigidly."""
    random = np.random.default_rng(10)
    turns = [exponential(np.array([0, 0, 0, *random.normal(0, 0.1, 3)]))[:3, :3] for _ in range(len(nodes))]
    rotations = np.array(turns) + random.normal(0, 0.02, (len(nodes), 3, 3))
    return Deformation(nodes, rotations, random.normal(0, 0.05, (len(nodes), 3)))


@pytest.mark.slow
@pytest.mark.parametrize("every", [90, 1100])
def test_sample_and_deform(session, every):
    """With nodes by the dozen and with just enough of them."""
    surfels = many_surfels()
    surfels["confidence"][90:270] = 0  # no node from here
    on_device = written(session, surfels)
    deformer = MapDeformer(session, on_device)
    nodes, expected_nodes = deformer.sample(every), reference.sample_nodes(surfels, every)
    np.testing.assert_array_equal(nodes.positions, expected_nodes["position"])
    np.testing.assert_array_equal(nodes.times, expected_nodes["first_seen"])
    assert nodes.usable

    deformation = bent_graph(nodes)
    deformer.deform(deformation, 60)
    expected, got = reference.deform(surfels, deformation), on_device.read(removed=True)
    np.testing.assert_allclose(got["position"], expected["position"], atol=2e-5)
    np.testing.assert_allclose(got["normal"], expected["normal"], atol=2e-5)
    for name in ("confidence", "radius", "colour", "first_seen", "last_seen"):
        np.testing.assert_array_equal(got[name], expected[name])


def test_an_empty_map_has_no_nodes(session):
    assert len(MapDeformer(session, Surfels(session, 10)).sample(5)) == 0


def test_reactivate(session):
    surfels = first_map()
    random = np.random.default_rng(11)
    surfels["confidence"] = random.choice([0.0, 1.0, 5.0], len(surfels))
    surfels["position"] += random.choice([-0.3, 0.0, 0.3], len(surfels))[:, None] * START[:3, 2]
    surface = scene(0).raw
    on_device, depth = written(session, surfels), uploaded(session, surface.astype(np.float32))
    image = SimpleNamespace(camera=CAMERA, depth=depth)
    MapDeformer(session, on_device).reactivate(image, START, 77, THRESHOLD)
    expected = reference.reactivate(surfels, surface, CAMERA, START, 77, THRESHOLD)
    assert 50 < (expected["last_seen"] == 77).sum() < (surfels["confidence"] == 5).sum() - 50
    assert (on_device.read(removed=True)["last_seen"] != expected["last_seen"]).mean() < 0.01
