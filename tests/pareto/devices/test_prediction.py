"""Beliefs and what measurements make of them."""

import numpy as np
import pytest

from pareto.devices.prediction import Belief, Observation

COVARIANCE = np.array([[0.04, 0.03, 0.0], [0.03, 0.09, 0.0], [0.0, 0.0, 0.01]])
BELIEF = Belief(np.array([1.0, 2.0, 3.0]), COVARIANCE)


def measured(place: int, value: float, error: float = 0.1) -> Observation:
    return Observation(np.array([place]), np.array([value]), np.array([error]))


NOTHING = Observation(np.array([], dtype=np.intp), np.array([]), np.array([]))


def test_one_measurement_moves_what_varies_with_it_and_nothing_else() -> None:
    after = BELIEF.after(measured(0, 1.2))
    gain = COVARIANCE[:, 0] / (0.04 + 0.01)  # by hand: one observation with an error of 0.1
    assert after.mean == pytest.approx(BELIEF.mean + gain * 0.2, abs=1e-6)
    assert after.covariance == pytest.approx(COVARIANCE - np.outer(gain, COVARIANCE[0]), abs=1e-6)
    assert after.mean[2] == 3.0


def test_without_measurements_nothing_changes() -> None:
    assert BELIEF.after(NOTHING) is BELIEF


def test_relatives_count_by_the_relation() -> None:
    relative = [measured(1, 2.5)]
    alone = BELIEF.after(NOTHING, relative)
    close = Belief(BELIEF.mean, COVARIANCE, relation=0.9).after(NOTHING, relative)
    distant = Belief(BELIEF.mean, COVARIANCE, relation=0.3).after(NOTHING, relative)
    own = BELIEF.after(relative[0])
    assert alone.mean[1] == 2.0
    assert 2.0 < distant.mean[1] < close.mean[1] < own.mean[1] < 2.5
    assert own.deviation[1] < close.deviation[1] < distant.deviation[1] < BELIEF.deviation[1]


def test_two_relatives_teach_more_than_one() -> None:
    belief = Belief(BELIEF.mean, COVARIANCE, relation=0.8)
    one = belief.after(NOTHING, [measured(0, 1.3)])
    two = belief.after(NOTHING, [measured(0, 1.3), measured(0, 1.3)])
    assert two.deviation[0] < one.deviation[0]
