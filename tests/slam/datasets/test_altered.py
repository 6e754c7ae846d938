import numpy as np
import pytest

from slam.datasets import SequenceError
from slam.datasets.altered import Altered, Dropped, Perturbed
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


def test_perturbed_depth_differs_by_a_unit_at_most_and_stays_unmeasured_where_it_was():
    frames = np.full((3, 40, 50), 1000)
    frames[:, :, 0], frames[:, :, 1], frames[:, :, 2] = 0, 1, 65535
    plain = ArraySequence(frames, truth=np.tile(np.eye(4), (3, 1, 1)))
    perturbed = Perturbed(plain, 7)

    depth = perturbed.depth(1).astype(int)

    assert set(np.unique(depth[:, 3:])) == {999, 1000, 1001}
    assert set(np.unique(depth[:, 0])) == {0}
    assert set(np.unique(depth[:, 1])) == {1, 2}  # 0 would be a depth that was not measured
    assert set(np.unique(depth[:, 2])) == {65534, 65535}
    assert perturbed.depth(1).dtype == np.uint16
    assert len(perturbed) == 3
    assert perturbed.name == plain.name


def test_equal_seeds_perturb_alike_and_others_otherwise(sequence):
    first, again, other = Perturbed(sequence, 1), Perturbed(sequence, 1), Perturbed(sequence, 2)
    np.testing.assert_array_equal(first.depth(4), again.depth(4))
    assert (first.depth(4) != other.depth(4)).any()
    assert (first.depth(4) != first.depth(3)).any()
    np.testing.assert_array_equal(first.colour(4), sequence.colour(4))
    assert first.sha256 == again.sha256
    assert len({sequence.sha256, first.sha256, other.sha256}) == 3


def test_a_negative_perturbation_is_refused(sequence):
    with pytest.raises(SequenceError, match="perturbation -1: give a whole number of 0 or more"):
        Perturbed(sequence, -1)


def test_dropped_frames_are_missing_with_stamps_and_truth_and_the_seed_decides_which(sequence):
    sequence._depth = np.arange(1, 7).reshape(6, 1, 1) * np.ones((6, 4, 5), np.uint16)
    sequence.truth = np.tile(np.eye(4), (6, 1, 1))
    sequence.truth[:, 0, 3] = np.arange(6)
    dropped = Dropped(sequence, 0.5, seed=1)
    kept = np.rint(dropped.timestamps * 30).astype(int)
    assert kept[0] == 0
    assert 1 <= len(dropped) == len(kept) < 6
    assert [int(dropped.depth(i)[0, 0]) for i in range(len(dropped))] == (kept + 1).tolist()
    assert dropped.truth[:, 0, 3].tolist() == kept.tolist()
    assert dropped.colour(0).shape == (4, 5, 3)
    assert dropped.sha256 == Dropped(sequence, 0.5, seed=1).sha256 != sequence.sha256
    assert len({Dropped(sequence, 0.5, seed=seed).sha256 for seed in range(5)}) > 1


@pytest.mark.parametrize(("share", "seed"), [(1.0, 0), (-0.1, 0), (float("nan"), 0), (0.5, -1)])
def test_a_share_or_a_seed_that_makes_no_sense_is_refused(sequence, share, seed):
    with pytest.raises(SequenceError, match="give a"):
        Dropped(sequence, share, seed)
