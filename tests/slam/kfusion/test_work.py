"""How much a configuration computes in a frame."""

import pytest

from slam.camera import Camera
from slam.devices.layout import Layout
from slam.kfusion.configuration import Configuration
from slam.kfusion.plan import plan
from slam.kfusion.work import FRAMES, LAUNCHES, OTHER, STEPS, Work, work
from slam.system import Scene

SCENE = Scene(Camera(481.2, 480.0, 319.5, 239.5, 640, 480), 4.8, (0.5, 0.5, 0.1))
COUNTED = range(10, 100)


def of(**changes: float) -> Work:
    configuration = Configuration.from_mapping({"compute_size_ratio": 2} | changes)
    return work(plan(configuration, SCENE, Layout("pixels")), COUNTED)


def test_voxels_are_counted_in_the_frames_that_integrate() -> None:
    every = of(volume_resolution=128, integration_rate=1)
    fifth = of(volume_resolution=128, integration_rate=5)

    assert every["integration", "voxels"] == pytest.approx(128**3, rel=0.01)
    assert fifth["integration", "voxels"] == pytest.approx(every["integration", "voxels"] / 5)


def test_pixels_are_tracked_once_an_iteration_in_the_frames_that_track() -> None:
    iterations = {
        "pyramid_iterations_fine": 8,
        "pyramid_iterations_middle": 0,
        "pyramid_iterations_coarse": 0,
    }
    once, twice = of(**iterations | {"pyramid_iterations_fine": 4}), of(**iterations)
    pixels = 320 * 240  # compute_size_ratio is 2

    assert twice["tracking", "tracked pixels"] - once["tracking", "tracked pixels"] == pytest.approx(
        4 * pixels, rel=0.01
    )
    assert of(tracking_rate=3)["tracking", "tracked pixels"] == pytest.approx(
        of()["tracking", "tracked pixels"] / 3
    )


def test_a_ray_takes_longer_steps_where_mu_is_larger() -> None:
    near, far = of(mu=0.1), of(mu=0.2)

    assert near["raycasting", "rays"] == far["raycasting", "rays"] == 320 * 240
    assert near["raycasting", STEPS] == pytest.approx(2 * far["raycasting", STEPS])


def test_launches_and_the_frame_itself_are_resources() -> None:
    found = of()

    assert found[OTHER, FRAMES] == 1.0
    assert found["preprocessing", LAUNCHES] == 4.0
    assert found["raycasting", LAUNCHES] == 1.0
    assert found["tracking", LAUNCHES] > 2 * 19  # two for each of the default's iterations
