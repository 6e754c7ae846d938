import numpy as np
import pytest

from slam.datasets.plausibility import depth_warning
from tests.slam.sequences import ArraySequence


@pytest.mark.parametrize(
    ("millimetres", "assumed", "doubted"),
    [
        (2000, None, False),
        (400, None, False),  # a sensor that measures from close by
        (400, 1000.0, False),
        (400, 5000.0, True),  # what is 2 m away, in millimetres, read as 5000 units a metre
        (200, None, True),
        (12_000, None, True),
    ],
)
def test_a_median_depth_that_no_room_has_is_doubted(millimetres, assumed, doubted):
    depth = np.zeros((2, 6, 8))
    depth[:, 2:] = millimetres
    sequence = ArraySequence(depth)
    sequence.assumed_units = assumed
    warning = depth_warning(sequence)
    assert (warning is not None) == doubted
    if doubted:
        assert f"{millimetres / 1000:.2f} m" in warning
        assert "--units" in warning
        assert ("5000 units per metre were assumed" in warning) == (assumed is not None)


def test_frames_without_depth_are_reported():
    assert "no depth is measured" in depth_warning(ArraySequence(np.zeros((2, 6, 8))))
