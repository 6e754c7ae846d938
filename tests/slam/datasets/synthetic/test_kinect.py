import numpy as np
import pytest

from slam.camera import Camera
from slam.datasets.synthetic import kinect

CAMERA = Camera(481.2, 480.0, 319.5, 239.5, 640, 480)


def measured(depth, blind=None, seed=0):
    blind = np.zeros(depth.shape, bool) if blind is None else blind
    return kinect.measure(depth, blind, CAMERA, np.random.default_rng(seed))


def wall(metres):
    return np.full((480, 640), metres)


@pytest.mark.parametrize(("metres", "step"), [(1.0, 3), (2.0, 12), (3.0, 26)])
def test_depth_comes_in_steps_that_grow_with_the_square_of_the_distance(metres, step):
    values = np.unique(measured(wall(metres)))
    steps = np.diff(values[values > 0])
    assert steps.max() == pytest.approx(step, abs=2)


def test_noise_has_no_bias_and_grows_with_distance():
    deviations = []
    for metres in (1.0, 2.0, 3.0):
        slope = np.broadcast_to(metres + np.linspace(-0.1, 0.1, 640), (480, 640))
        depth = measured(slope)
        errors = (depth / 1000 - slope)[depth > 0]
        assert abs(errors.mean()) < 0.001
        deviations.append(errors.std())
    assert deviations[0] < deviations[1] / 2 < deviations[2] / 4


@pytest.mark.parametrize("metres", [0.3, 5.0, np.inf])
def test_what_is_too_near_or_too_far_is_not_measured(metres):
    assert (measured(wall(metres)) == 0).mean() > 0.99


def test_an_object_casts_a_shadow_to_its_left_only():
    depth = wall(3.0)
    depth[:, 300:340] = 1.5
    missing = (measured(depth) == 0).mean(axis=0)
    # The projector stands 75 mm to the side: 481 * 0.075 * (1/1.5 - 1/3) = 12 pixels.
    assert (missing[289:299] > 0.95).all()
    assert missing[270:285].mean() < 0.05
    assert missing[343:360].mean() < 0.05


def test_surfaces_seen_at_a_grazing_angle_fade():
    v = np.arange(480)[:, None]
    floor = np.broadcast_to(0.2 / np.maximum((v - 239.5) / 480.0, 0.04), (480, 640))
    missing = (measured(np.minimum(floor, 4.4)) == 0).mean(axis=1)
    assert missing[260:275].mean() > 0.8
    assert missing[450:].mean() < 0.1


def test_glass_sends_nothing_back():
    blind = np.zeros((480, 640), bool)
    blind[100:200, 100:200] = True
    depth = measured(wall(2.0), blind)
    assert (depth[100:200, 100:200] == 0).all()
    assert (depth[250:, 250:] > 0).mean() > 0.99


def test_equal_seeds_give_equal_images():
    np.testing.assert_array_equal(measured(wall(2.0), seed=4), measured(wall(2.0), seed=4))
    assert (measured(wall(2.0), seed=4) != measured(wall(2.0), seed=5)).any()


def with_sensor(depth, sensor, albedo=None, distortion=None):
    blind = np.zeros(depth.shape, bool)
    return kinect.measure(depth, blind, CAMERA, np.random.default_rng(0), sensor, albedo, distortion)


def test_dark_surfaces_are_measured_from_near_and_not_from_afar():
    albedo = np.full((480, 640), 0.06)
    sensor = kinect.Sensor(faintest=0.035)
    missing = [(with_sensor(wall(metres), sensor, albedo) == 0).mean() for metres in (1.0, 1.55, 2.2)]
    assert missing[0] < 0.05
    assert 0.2 < missing[1] < 0.8
    assert missing[2] > 0.99


def test_more_disparity_noise_scatters_depth_more():
    depths = [with_sensor(wall(2.0), kinect.Sensor(disparity_sigma=s)) for s in (1 / 6, 1.0)]
    spread = [depth[depth > 0].std() for depth in depths]
    assert spread[1] > 1.5 * spread[0]


def test_a_distortion_shifts_disparity():
    unit = kinect.make_distortion(CAMERA, np.random.default_rng(1))
    assert np.abs(np.diff(unit, axis=1)).max() < 0.05
    depth = with_sensor(wall(2.0), kinect.Sensor(distortion=1.0), None, unit).astype(float)
    seen = depth > 0
    # An eighth of a pixel more disparity is 2 m * 2 m / 351 m = 11 mm less depth.
    assert np.polyfit(unit[seen], depth[seen], 1)[0] == pytest.approx(-11.4, abs=2)
