"""Another device's front on this one: its order and expected values, and the effect of a few measurements."""

import numpy as np
import pytest

from pareto import Objective
from pareto.devices.correlation import correlate
from pareto.devices.zero_shot import expected_points
from pareto.errors import ConfigurationError, ObjectiveError
from tests.builders import convolution
from tests.builders.spaces import space_of

SPACE = space_of(x=range(100))


def pairs(rows):
    return [
        ({"x": x}, None if error is None else {"error": error, "seconds": seconds})
        for x, error, seconds in rows
    ]


SOURCE = pairs([(x, 0.01 * x + 0.01, 1.0 / (x + 1)) for x in range(10)] + [(50, 0.5, 5.0), (60, None, None)])


def order(promises):
    return [promise.configuration["x"] for promise in promises]


def test_without_measurements_here_the_sources_values_decide():
    promises = expected_points(SPACE, ("error", "seconds"), SOURCE, prefer="seconds")
    assert order(promises) == list(range(9, -1, -1))  # 50 is dominated, 60 failed
    assert promises[0].expected == promises[0].source == {"error": pytest.approx(0.10), "seconds": 0.1}
    assert not any(promise.measured for promise in promises)
    assert order(expected_points(SPACE, ("error", "seconds"), SOURCE)) == list(range(10))


def test_what_breaks_a_limit_comes_last():
    limits = {"error": 0.05}
    promises = expected_points(SPACE, ("error", "seconds"), SOURCE, prefer="seconds", limits=limits)
    assert order(promises) == [4, 3, 2, 1, 0, 9, 8, 7, 6, 5]
    assert [promise.within for promise in promises] == [True] * 5 + [False] * 5


def test_one_measurement_moves_everything_by_its_factor():
    here = pairs([(4, 0.05, 2.0)])  # ten times slower, equally accurate
    promises = expected_points(
        SPACE, ("error", "seconds"), SOURCE, here, limits={"seconds": 2.1}, prefer="seconds"
    )
    expected = {promise.configuration["x"]: promise.expected for promise in promises}
    assert expected[4] == {"error": 0.05, "seconds": 2.0}
    assert expected[9]["seconds"] == pytest.approx(1.0)
    assert expected[0]["error"] == pytest.approx(0.01)
    assert [promise.configuration["x"] for promise in promises if not promise.within] == [3, 2, 1, 0]
    assert [promise.configuration["x"] for promise in promises if promise.measured] == [4]


def test_measurements_that_agree_on_another_slope_are_followed():
    here = pairs([(x, 0.01 * x + 0.01, 3.0 * (1 / (x + 1)) ** 0.5) for x in (0, 2, 4, 6, 8)])
    expected = {
        promise.configuration["x"]: promise.expected
        for promise in expected_points(SPACE, ("error", "seconds"), SOURCE, here)
    }
    assert expected[9]["seconds"] == pytest.approx(3.0 * 0.1**0.5, rel=1e-3)
    assert expected[9]["error"] == pytest.approx(0.1, rel=1e-6)


def test_measurements_that_agree_on_nothing_are_mostly_ignored():
    noise = np.exp(np.random.default_rng(0).normal(size=40))
    source = pairs([(x, 0.01 * x + 0.01, 1.0 / (x + 1)) for x in range(80)])
    here = pairs([(2 * x, 0.02 * x + 0.01, noise[x] / (2 * x + 1)) for x in range(40)])
    promises = expected_points(SPACE, ("error", "seconds"), source, here)
    factors = {
        promise.expected["seconds"] / promise.source["seconds"]
        for promise in promises
        if not promise.measured
    }
    assert np.std(np.log(list(factors))) < 0.6 * np.std(np.log(noise))


def test_more_than_the_front_is_taken_front_after_front():
    promises = expected_points(SPACE, ("error", "seconds"), SOURCE, count=11)
    assert sorted(order(promises)) == [*range(10), 50]
    assert len(expected_points(SPACE, ("error", "seconds"), SOURCE, count=3)) == 3


def test_what_failed_here_is_left_out_and_what_was_measured_stands():
    here = [({"x": 9}, None), *pairs([(3, 0.9, 0.9)])]
    promises = expected_points(SPACE, ("error", "seconds"), SOURCE, here)
    assert 9 not in order(promises)
    [third] = [promise for promise in promises if promise.configuration["x"] == 3]
    assert third.expected == {"error": 0.9, "seconds": 0.9}
    assert third.source["seconds"] == 0.25


def test_maximised_objectives_and_values_without_logarithm():
    objectives = (Objective("gain", maximise=True),)
    source = [({"x": x}, {"gain": float(x - 5)}) for x in range(10)]
    [best] = expected_points(SPACE, objectives, source, [({"x": 4}, {"gain": 9.0})])
    assert best.configuration == {"x": 9}
    assert best.expected == {"gain": 14.0}  # the difference at x = 4 is 10


def test_nothing_measured_there_promises_nothing():
    assert expected_points(SPACE, ("error",), []) == []
    assert expected_points(SPACE, ("error",), [({"x": 1}, None)]) == []


def test_bad_input_is_named():
    with pytest.raises(ObjectiveError, match="'watts' is not an objective"):
        expected_points(SPACE, ("error", "seconds"), SOURCE, prefer="watts")
    with pytest.raises(ObjectiveError, match="'watts'"):
        expected_points(SPACE, ("error", "seconds"), SOURCE, limits={"watts": 3})
    with pytest.raises(ConfigurationError, match="100"):
        expected_points(SPACE, ("error",), [({"x": 100}, {"error": 1.0})])


@pytest.mark.slow
def test_a_few_measurements_put_the_fastest_of_one_gpu_in_the_order_of_another():
    """Among the 200 fastest of an A100, its order says little of an A4000; 20 measurements there say much."""
    space = convolution.space()
    there = [(point, {"time": time}) for point, time in convolution.measured("A100") if time is not None]
    target = {space.encode(point): time for point, time in convolution.measured("A4000")}

    def agreement(here):
        promises = expected_points(space, ("time",), there, here, count=200)
        new = [item for item in promises if not item.measured]
        actual = [target[space.encode(item.configuration)] for item in new]
        return correlate(range(len(new)), actual).spearman.value

    best = [item.configuration for item in expected_points(space, ("time",), there, count=200)]
    some = np.random.default_rng(0).permutation(200)[:20]
    measured = [(best[i], {"time": target[space.encode(best[i])]}) for i in some]
    assert agreement([]) < 0.3
    assert agreement(measured) > 0.6
