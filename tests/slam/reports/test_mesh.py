import numpy as np
import pytest

from slam.benchmark import run
from slam.datasets import open_sequence
from slam.reports.mesh import Mesh, extract
from tests.shipped import LIVING_ROOM

CENTRE = np.array([0.5, 0.46, 0.53])  # x y z, metres
RADIUS = 0.3


class ArrayField:
    """A distance field held in memory, in a cube of one metre."""

    def __init__(self, distances):
        self.distances = np.asarray(distances, np.float32)
        self.weights = np.ones(self.distances.shape, np.uint8)
        self.resolution = len(self.distances)
        self.voxel_size = 1 / self.resolution

    def read(self, first, last):
        return self.distances[first:last], self.weights[first:last]


def sphere(resolution):
    z, y, x = (np.mgrid[:resolution, :resolution, :resolution] + 0.5) / resolution
    return ArrayField(np.sqrt((x - CENTRE[0]) ** 2 + (y - CENTRE[1]) ** 2 + (z - CENTRE[2]) ** 2) - RADIUS)


def sides(mesh):
    """How often each triangle side occurs, by its two vertices in the triangle's direction."""
    begin, end = mesh.triangles.astype(np.int64).ravel(), np.roll(mesh.triangles, -1, axis=1).ravel()
    keys, counts = np.unique(begin * len(mesh.vertices) + end, return_counts=True)
    return dict(zip(keys.tolist(), counts.tolist(), strict=True))


def is_closed(mesh):
    """Whether every side of a triangle is the side of exactly one other, in the opposite direction."""
    found, count = sides(mesh), len(mesh.vertices)
    return set(found.values()) == {1} and all(key % count * count + key // count in found for key in found)


def corners(mesh):
    return (mesh.vertices[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))


def test_a_sphere_is_closed_and_of_the_right_size():
    mesh = extract(sphere(48))
    assert is_closed(mesh)
    assert len(mesh.vertices) - len(sides(mesh)) / 2 + len(mesh.triangles) == 2  # Euler: no handle, one piece
    distance = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    np.testing.assert_allclose(distance, RADIUS, atol=0.05 / 48)
    a, b, c = corners(mesh)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=5e-3)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi * RADIUS**2, rel=5e-3)


def test_normals_point_into_free_space():
    mesh = extract(sphere(48))
    outward = (mesh.vertices - CENTRE) / RADIUS
    assert np.einsum("ij,ij->i", mesh.normals, outward).min() > 0.99


def test_every_case_of_a_cell_meets_its_neighbours():
    # Noise shows all 256 cases, ambiguous faces among them; free space around it closes the surface.
    distances = np.random.default_rng(0).normal(size=(22, 22, 22))
    for axis in range(3):
        distances.swapaxes(0, axis)[[0, -1]] = 1
    mesh = extract(ArrayField(distances))
    assert is_closed(mesh)
    assert len(mesh.triangles) > 20_000


def test_cells_with_an_unobserved_corner_are_left_out():
    field = sphere(32)
    field.weights[:, :, :16] = 0  # nothing was seen for x below a half
    mesh = extract(field)
    assert mesh.vertices[:, 0].min() >= 16.5 / 32 - 1e-6
    assert not is_closed(mesh)


def test_nothing_observed_is_an_empty_mesh(tmp_path):
    field = sphere(16)
    field.weights[:] = 0
    mesh = extract(field)
    assert mesh.vertices.shape == mesh.normals.shape == mesh.triangles.shape == (0, 3)
    mesh.write(tmp_path / "empty.ply")
    assert b"element face 0\n" in (tmp_path / "empty.ply").read_bytes()


def test_a_ply_file_holds_what_was_written(tmp_path):
    mesh = extract(sphere(12))
    mesh.write(tmp_path / "sphere.ply")
    again = read_ply(tmp_path / "sphere.ply")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.normals, mesh.normals)
    np.testing.assert_array_equal(again.triangles, mesh.triangles)


def read_ply(path):
    header, body = path.read_bytes().split(b"end_header\n", 1)
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = {line.split()[1]: int(line.split()[2]) for line in lines if line.startswith("element")}
    vertices = np.frombuffer(body, "<f4", 6 * count["vertex"]).reshape(-1, 6)
    faces = np.frombuffer(
        body, [("count", "u1"), ("corners", "<i4", 3)], count["face"], offset=vertices.nbytes
    )
    assert vertices.nbytes + faces.nbytes == len(body)
    assert set(faces["count"]) <= {3}
    return Mesh(vertices[:, :3], vertices[:, 3:], faces["corners"])


def test_a_volume_is_read_back_in_any_slabs():
    systems = []
    configuration = {"compute_size_ratio": 8, "volume_resolution": 64, "integration_rate": 1}
    run(configuration, open_sequence(LIVING_ROOM), frames=3, observe=lambda _, s: systems.append(s))
    volume = systems[-1].volume
    distances, weights = volume.read(0, 64)
    assert distances.shape == weights.shape == (64, 64, 64)
    assert (distances.min(), distances.max()) == (pytest.approx(-1, abs=0.05), 1)
    assert set(np.unique(weights)) == {0, 1, 2, 3}
    assert (distances[weights == 0] == 1).all()
    part = volume.read(20, 31)
    np.testing.assert_array_equal(part[0], distances[20:31])
    np.testing.assert_array_equal(part[1], weights[20:31])


def test_the_mesh_of_a_run_lies_where_its_views_do():
    systems = []
    configuration = {"compute_size_ratio": 4, "volume_resolution": 128, "integration_rate": 1}
    sequence = open_sequence(LIVING_ROOM)
    run(configuration, sequence, frames=6, observe=lambda _, system: systems.append(system))
    mesh = extract(systems[-1].volume)
    view = systems[-1].view()
    seen = view.vertices.any(axis=2)
    points, normals = view.vertices[seen][::37], view.normals[seen][::37]
    nearest = [int(np.linalg.norm(mesh.vertices - point, axis=1).argmin()) for point in points]
    # A shift by half a voxel anywhere would show here as a half; noise spreads to either side.
    offset = np.einsum("ij,ij->i", points - mesh.vertices[nearest], normals) / systems[-1].volume.voxel_size
    assert abs(np.median(offset)) < 0.1
    assert np.median(np.abs(offset)) < 0.2
