import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.camera import Camera
from slam.datasets.synthetic.place import turn
from slam.datasets.synthetic.shapes import Shape, paint, render

CAMERA = Camera(60.0, 60.0, 31.5, 23.5, 64, 48)


def seen(shape, pose=None):
    return render([shape], CAMERA, np.eye(4) if pose is None else pose).depth


def points(depth):
    v, u = np.nonzero(np.isfinite(depth))
    z = depth[v, u]
    return np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], axis=1)


def shape(kind, size=(0.8, 0.6, 0.5), **details):
    return Shape(kind, np.array([0.0, 0.0, 2.0]), np.array(size) / 2, **details)


def test_a_box_shows_its_front_face():
    depth = seen(shape("box"))
    assert depth[24, 32] == pytest.approx(1.75)
    width = np.isfinite(depth[24]).sum()
    assert width == pytest.approx(60 * 0.8 / 1.75, abs=1)


def test_every_point_of_an_ellipsoid_lies_on_it():
    surface = points(seen(shape("ellipsoid"))) - [0, 0, 2]
    assert len(surface) > 200
    np.testing.assert_allclose(np.sum((surface / [0.4, 0.3, 0.25]) ** 2, axis=1), 1, atol=1e-9)


@pytest.mark.parametrize("top", [1.0, 0.5, 1.4])
def test_a_frustum_is_as_wide_as_its_radius_at_every_height(top):
    x, y, z = (points(seen(shape("frustum", (0.6, 0.6, 0.6), top=top))) - [0, 0, 2]).T
    radius = 0.3 * (1 + top) / 2 + 0.3 * (1 - top) / 0.6 * y
    on_mantle = np.abs(np.hypot(x, z) - radius) < 1e-9
    on_disc = (np.abs(np.abs(y) - 0.3) < 1e-9) & (np.hypot(x, z) <= radius + 1e-9)
    assert (on_mantle | on_disc).all()
    assert on_mantle.sum() > 100


def test_a_rounded_box_has_round_edges_and_flat_faces():
    surface = points(seen(shape("rounded", edge=0.1))) - [0, 0, 2]
    outside = np.maximum(np.abs(surface) - (np.array([0.4, 0.3, 0.25]) - 0.1), 0)
    np.testing.assert_allclose(np.linalg.norm(outside, axis=1), 0.1, atol=2e-4)
    assert (np.abs(surface[:, 2] + 0.25) < 1e-4).sum() > 100


@pytest.mark.slow
@given(st.floats(-180, 180), st.floats(-80, 80), st.floats(-180, 180))
def test_a_sphere_looks_the_same_however_it_is_turned(yaw, pitch, roll):
    ball = shape("ellipsoid", (0.6, 0.6, 0.6), rotation=turn(yaw, pitch, roll))
    np.testing.assert_allclose(seen(ball), seen(shape("ellipsoid", (0.6, 0.6, 0.6))), atol=1e-9)


@given(st.floats(-20, 20), st.floats(-0.5, 0.5))
def test_moving_the_camera_is_moving_the_world_the_other_way(yaw, x):
    pose = np.eye(4)
    pose[:3, :3], pose[0, 3] = turn(yaw), x
    inverse = np.linalg.inv(pose)
    centre = inverse[:3, :3] @ [0, 0, 2] + inverse[:3, 3]
    moved = Shape("box", centre, np.array([0.4, 0.3, 0.25]), inverse[:3, :3])
    here, there = seen(shape("box"), pose), seen(moved)
    # Rays that graze an edge may fall on either side of it.
    differing = np.isfinite(here) != np.isfinite(there)
    assert differing.sum() <= 4
    both = np.isfinite(here) & np.isfinite(there)
    assert np.quantile(np.abs(here[both] - there[both]), 0.99) < 1e-6 if both.any() else True


def test_the_nearer_shape_hides_the_farther_one():
    near = Shape("box", np.array([0, 0, 1.0]), np.array([0.1, 0.1, 0.1]))
    view = render([shape("box"), near], CAMERA, np.eye(4))
    assert view.shape[24, 32] == 1
    assert view.depth[24, 32] == pytest.approx(0.9)
    assert view.shape[24, 22] == 0
    assert view.shape[0, 0] == -1


def test_what_is_behind_the_camera_is_not_seen():
    behind = Shape("box", np.array([0, 0, -2.0]), np.array([0.4, 0.3, 0.25]))
    assert np.isinf(seen(behind)).all()


@pytest.mark.parametrize("pattern", ["plain", "wood", "weave", "speckle", "print"])
def test_patterns_are_textured_and_keep_to_their_colour(pattern):
    red = shape("box", colour=(200, 20, 20), pattern=pattern)
    view = render([red], CAMERA, np.eye(4))
    image = paint([red], CAMERA, np.eye(4), view)
    inside = image[view.shape == 0].astype(float)
    assert inside[:, 0].std() > 1
    assert (inside[:, 0] > 4 * inside[:, 1]).all()
    assert (image[view.shape < 0] == 0).all()
