"""The map as a PLY file, read back as its header says."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slam.elasticfusion.mapping import cloud
from slam.elasticfusion.mapping.surfels import SURFEL

KINDS = {"float": "<f4", "uchar": "u1"}


def read(path: Path) -> np.ndarray:
    """The vertices of a binary PLY file, laid out by its header alone."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    (count,) = [int(line.split()[-1]) for line in lines if line.startswith("element vertex")]
    fields = [line.split()[1:] for line in lines if line.startswith("property")]
    vertices = np.frombuffer(body, [(name, KINDS[kind]) for kind, name in fields])
    assert len(vertices) == count
    return vertices


def test_a_cloud_holds_the_stable_surfels(tmp_path):
    surfels = np.zeros(3, SURFEL)
    surfels["position"], surfels["normal"] = np.arange(9).reshape(3, 3), [0.0, 0.6, -0.8]
    surfels["confidence"], surfels["radius"] = [12.0, 3.0, 10.0], [0.01, 0.02, 0.03]
    surfels["colour"] = 10 | 20 << 8 | 200 << 16
    assert cloud.write(tmp_path / "map.ply", surfels, least_confidence=10) == 2
    vertices = read(tmp_path / "map.ply")
    assert vertices.dtype.names == (
        "x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "radius", "confidence",
    )  # fmt: skip
    assert [vertices[name].tolist() for name in "xyz"] == [[0, 6], [1, 7], [2, 8]]
    np.testing.assert_allclose([vertices[name][1] for name in ("nx", "ny", "nz")], [0, 0.6, -0.8])
    assert [vertices[name][1] for name in ("red", "green", "blue")] == [10, 20, 200]
    np.testing.assert_allclose(vertices["radius"], [0.01, 0.03])
    np.testing.assert_allclose(vertices["confidence"], [12, 10])


def test_a_cloud_of_nothing_is_a_file_without_vertices(tmp_path):
    assert cloud.write(tmp_path / "map.ply", np.zeros(0, SURFEL)) == 0
    assert len(read(tmp_path / "map.ply")) == 0
