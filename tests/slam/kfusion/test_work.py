"""How much a configuration computes in a frame."""

import math
from dataclasses import asdict

import pytest

from slam.benchmark import Report, run
from slam.camera import Camera
from slam.datasets import open_sequence
from slam.devices.layout import Layout
from slam.kfusion.configuration import ANDROID_APP, Configuration
from slam.kfusion.plan import plan
from slam.kfusion.work import FRAMES, LAUNCHES, OTHER, STEPS, Work, stage_ratios, work
from slam.system import Scene, scene_of
from tests.shipped import LIVING_ROOM

SCENE = Scene(Camera(481.2, 480.0, 319.5, 239.5, 640, 480), 4.8, (0.5, 0.5, 0.1))
COUNTED = range(10, 100)
FIRST, LAST = 10, 26  # counted frames of short runs: each configuration integrates in one of them


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
    resources = of()

    assert resources[OTHER, FRAMES] == 1.0
    assert resources["preprocessing", LAUNCHES] == 4.0
    assert resources["raycasting", LAUNCHES] == 1.0
    assert resources["tracking", LAUNCHES] > 2 * 19  # two for each of the default's iterations


def shortest(report: Report, stage: str) -> float:
    """Seconds of `stage` in the counted frames, as if nothing had disturbed it."""
    times = [frame.stages[stage] for frame in report.frames[FIRST:] if frame.stages[stage]]
    return min(times) * len(times)


@pytest.mark.slow
def test_the_stages_of_the_device_at_hand_lie_inside_their_ratios() -> None:
    """A device's caches make a stage up to 1.2 times as fast as its work says; twice is allowed."""
    names = ("STANDARD", "FAST1", "FAST3")
    reports = {
        name: run(asdict(ANDROID_APP[name]), open_sequence(LIVING_ROOM), frames=LAST) for name in names
    }
    scene = scene_of(open_sequence(LIVING_ROOM))
    plans = {name: plan(ANDROID_APP[name], scene, Layout("pixels")) for name in names}

    for name in names[1:]:
        for stage, (low, high) in stage_ratios(plans["STANDARD"], plans[name], range(FIRST, LAST)).items():
            if stage != OTHER:
                ratio = shortest(reports["STANDARD"], stage) / shortest(reports[name], stage)
                assert low / 2 <= ratio <= 2 * high, (name, stage)


def test_a_level_that_ends_early_needs_one_iteration() -> None:
    default, fast3 = (plan(ANDROID_APP[name], SCENE, Layout("pixels")) for name in ("STANDARD", "FAST3"))

    low, high = stage_ratios(default, fast3, COUNTED)["tracking"]

    # 10, 5 and 4 iterations of the default, on images of its levels, over one on each.
    assert high == pytest.approx((10 + 5 / 4 + 4 / 16) / (1 + 1 / 4 + 1 / 16))
    assert low == pytest.approx(1.0)  # kernels outside of the iterations


def test_what_a_stage_gains_lies_between_its_kernels_its_steps_and_its_launches() -> None:
    default, fast1 = (plan(ANDROID_APP[name], SCENE, Layout("pixels")) for name in ("STANDARD", "FAST1"))

    ratios = stage_ratios(default, fast1, COUNTED)

    assert ratios["preprocessing"] == (1.0, 4.0)  # launches, pixels
    assert ratios["raycasting"] == (1.0, pytest.approx(4 * 4.19017))  # launches, large steps
    assert ratios[OTHER] == (1.0, 1.0)


def test_a_share_that_is_left_out_divides_the_work() -> None:
    default = plan(ANDROID_APP["STANDARD"], SCENE, Layout("pixels"))
    fixed, adapting = (
        plan(Configuration(volume_resolution=128, integration_rate=1, **more), SCENE, Layout("pixels"))
        for more in ({}, {"skip_limit": 3, "skip_translation": 0.05, "integrate_translation": 0.05})
    )

    every, some = work(fixed, COUNTED), work(adapting, COUNTED, 0.6)
    assert some["integration", "voxels"] == pytest.approx(0.4 * every["integration", "voxels"])
    assert some[OTHER, FRAMES] == pytest.approx(0.4)

    before, after = (
        stage_ratios(default, one, COUNTED, 0.6 * (one is adapting)) for one in (fixed, adapting)
    )
    assert after["raycasting"] == pytest.approx([2.5 * ratio for ratio in before["raycasting"]])
    assert after["integration"] == (pytest.approx(2.5 * before["integration"][0]), math.inf)
    assert after[OTHER] == (pytest.approx(2.5), pytest.approx(2.5))
    # Where the share is not known, from none to what the limit allows.
    assert stage_ratios(default, adapting, COUNTED)[OTHER] == (1.0, pytest.approx(4.0))
