import numpy as np
import pytest

from slam.datasets import SequenceError
from slam.datasets.altered import Altered
from tests.slam.sequences import ArraySequence


@pytest.fixture
def sequence():
    frames = np.full((6, 4, 5), 1000)
    return ArraySequence(frames, np.full((6, 4, 5, 3), 90, np.uint8), np.tile(np.eye(4), (6, 1, 1)))


def test_dark_frames_show_nothing_and_the_others_all(sequence):
    altered = Altered(sequence, dark=(2, 3))
    assert [altered.depth(i).any() for i in range(6)] == [True, True, False, False, True, True]
    assert [altered.colour(i).any() for i in range(6)] == [True, True, False, False, True, True]
    assert len(altered.truth) == len(altered) == 6
    assert altered.sha256 != sequence.sha256


def test_a_badly_calibrated_camera_claims_other_focal_lengths_and_sees_the_same(sequence):
    altered = Altered(sequence, focal_error=0.02)
    assert altered.camera.fx == pytest.approx(1.02 * sequence.camera.fx)
    assert altered.camera.fy == pytest.approx(1.02 * sequence.camera.fy)
    assert altered.camera.cx == sequence.camera.cx
    np.testing.assert_array_equal(altered.depth(5), sequence.depth(5))
    assert altered.sha256 != sequence.sha256


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dark": (4, 6)}, "dark frames 4 to 6: give two of 0 to 5"),
        ({"dark": (3, 2)}, "dark frames 3 to 2"),
        ({"focal_error": 0.5}, "focal error 0.5: give a fraction between"),
    ],
)
def test_alterations_that_make_no_sense_are_refused(sequence, options, message):
    with pytest.raises(SequenceError, match=message):
        Altered(sequence, **options)
