import pytest

from slam.camera import Camera

KINECT = Camera(481.2, 480.0, 319.5, 239.5, 640, 480)


def test_scaling_divides_all_four_intrinsics_and_the_size():
    assert KINECT.scaled(4) == Camera(120.3, 120.0, 79.875, 59.875, 160, 120)


def test_a_ratio_that_does_not_divide_the_image_is_refused():
    with pytest.raises(ValueError, match="ratio 3 must be a positive divisor of 640x480"):
        KINECT.scaled(3)


@pytest.mark.parametrize(("field", "value"), [("fx", 0.0), ("fy", float("nan")), ("width", 0)])
def test_a_camera_that_sees_nothing_is_refused(field, value):
    with pytest.raises(ValueError, match=field if field != "width" else "0x480"):
        Camera(**{**KINECT.__dict__, field: value})
