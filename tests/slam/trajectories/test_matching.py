import numpy as np
import pytest

from slam.trajectories.evaluation import evaluate
from slam.trajectories.matching import match
from slam.trajectories.trajectory import Trajectory, TrajectoryError
from tests.slam.sequences import random_poses

SECONDS = np.arange(100) / 30


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9), ("frame numbers", 30)],
)
def test_stamps_in_another_unit_are_refused_and_the_unit_is_named(unit, factor):
    poses = random_poses(100, np.random.default_rng(0))
    estimate, truth = Trajectory(SECONDS * factor, poses), Trajectory(SECONDS, poses)
    with pytest.raises(TrajectoryError, match=f"stamps of the estimate are {unit}: write seconds"):
        evaluate(estimate, truth)
    with pytest.raises(TrajectoryError, match=f"stamps of the truth are {unit}: write seconds"):
        evaluate(truth, estimate)


def test_stamps_that_match_by_chance_are_refused():
    with pytest.raises(TrajectoryError, match=r"1 of 100 stamps .* lie within 0.01 s: give --max-difference"):
        match(SECONDS, SECONDS + SECONDS[-1], 0.01)


@pytest.mark.parametrize("name", ["estimate", "truth"])
def test_equal_stamps_are_refused(name):
    stamps = {"estimate": SECONDS, "truth": SECONDS, name: np.full(100, 0.5)}
    with pytest.raises(TrajectoryError, match=f"all 100 stamps of the {name} are 0.5: write the second"):
        match(stamps["estimate"], stamps["truth"], 0.01)


def test_a_short_trajectory_and_a_sparse_one_match_a_long_one():
    assert match(SECONDS[:1], SECONDS, 0.01)[1].tolist() == [0]
    assert match(SECONDS, SECONDS[::20], 0.01)[0].tolist() == [0, 20, 40, 60, 80]
