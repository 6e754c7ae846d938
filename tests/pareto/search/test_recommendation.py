"""The recommended front: the measured one where repeats agree, else what noise leaves of it."""

import json

import numpy as np
import pytest

from pareto import Explorer, Objective
from tests.builders.spaces import space_of
from tests.pareto.searches import explorer_of, measure, spend

SPACE = space_of(x=range(20), y=range(10))
CODES = SPACE.codes(np.arange(len(SPACE)))
TRUTH = np.stack([2.0 + CODES[:, 0] + 0.5 * CODES[:, 1], 30.0 - CODES[:, 0] + CODES[:, 1]], axis=1)


def measured(rng, noise, objectives=("a", "b"), limits=None, truth=TRUTH, repeats=(3, 1), additive=False):
    """An explorer that knows 80 points: 20 of them `repeats[0]` times, the others `repeats[1]` times."""
    explorer = Explorer(SPACE, objectives, limits, method="random")
    names = [item.name for item in explorer.objectives]
    chosen = rng.permutation(len(SPACE))[:80].tolist()
    for number, index in enumerate(chosen):
        for _ in range(repeats[number >= 20]):
            draw = noise * rng.standard_normal(len(names))
            values = truth[index] + draw if additive else truth[index] * np.exp(draw)
            explorer.tell([SPACE.decode(index)], [dict(zip(names, values.tolist(), strict=True))])
    return explorer


def as_measured(recommended):
    return [(item.configuration, item.values) for item in recommended]


def test_nothing_measured_or_nothing_that_succeeded_recommends_nothing():
    explorer = Explorer(SPACE, ("a",))
    assert explorer.recommended() == []
    explorer.tell([{"x": 1, "y": 1}] * 2, [None, None])
    assert explorer.recommended() == []


@pytest.mark.parametrize("repeats", [(1, 1), (3, 1), (3, 3)])
def test_where_repeats_agree_it_is_the_front_as_measured_without_doubt(repeats):
    explorer = measured(np.random.default_rng(1), 0.0, limits={"a": 15.0}, repeats=repeats)
    recommended = explorer.recommended()
    assert as_measured(recommended) == explorer.front()
    for item in recommended:
        assert item.intervals == {name: (value, value) for name, value in item.values.items()}


def test_after_a_search_of_a_deterministic_program_it_is_the_front():
    explorer = explorer_of("bayesian")
    spend(explorer, 60)
    assert as_measured(explorer.recommended()) == explorer.front()
    assert all(measure(item.configuration) == item.values for item in explorer.recommended())


def test_a_lucky_measurement_leaves_the_front():
    explorer = measured(np.random.default_rng(1), 0.1)
    free = [index for index in range(len(SPACE)) if index not in explorer.history.results]
    lucky = min(free, key=lambda index: abs(CODES[index, 0] - 10) + abs(CODES[index, 1] - 4))
    explorer.tell([SPACE.decode(lucky)], [dict(zip("ab", TRUTH[lucky] * 0.7, strict=True))])
    assert SPACE.decode(lucky) in [configuration for configuration, _ in explorer.front()]
    assert SPACE.decode(lucky) not in [item.configuration for item in explorer.recommended()]


def test_an_objective_of_which_repeats_agree_stays_as_it_was_measured():
    explorer = measured(np.random.default_rng(1), np.array([0.0, 0.1]))
    for item in explorer.recommended():
        exact = float(TRUTH[SPACE.encode(item.configuration), 0])
        assert item.values["a"] == exact
        assert item.intervals["a"] == (exact, exact)
        low, high = item.intervals["b"]
        assert low < item.values["b"] < high


@pytest.mark.slow
@pytest.mark.parametrize("additive", [False, True])
def test_intervals_cover_the_truth_about_as_often_as_they_say(additive):
    """95 in 100 is said; a few dozen repeats tell the noise itself only roughly."""
    inside, narrow = [], []
    truth = TRUTH - 20.0 if additive else TRUTH  # some negative: no logarithms
    for seed in range(6):
        noise = 1.5 if additive else 0.1
        explorer = measured(np.random.default_rng(seed), noise, truth=truth, additive=additive)
        for item in explorer.recommended():
            for name, value in zip("ab", truth[SPACE.encode(item.configuration)], strict=True):
                low, high = item.intervals[name]
                inside.append(low <= value <= high)
                narrow.append(high - low < (2 * 1.96 * noise * (1.0 if additive else item.values[name])))
    assert len(inside) > 50
    assert np.mean(inside) >= 0.8
    assert np.mean(narrow) >= 0.8  # neighbours and repeats tell more than one measurement


def test_limits_hold_for_expected_values_and_a_maximised_objective_is_turned_round():
    flipped = np.stack([TRUTH[:, 0], 40.0 - TRUTH[:, 1]], axis=1)
    objectives = ("a", Objective("rate", maximise=True))
    limits = {"a": 14.0, "rate": 13.0}
    explorer = measured(np.random.default_rng(1), 0.1, objectives, limits, flipped)
    recommended = explorer.recommended()
    assert len(recommended) > 2
    a, rate = ([item.values[name] for item in recommended] for name in ("a", "rate"))
    assert max(a) <= 14.0
    assert min(rate) >= 13.0
    assert a == sorted(a)
    assert rate == sorted(rate)
    for item in recommended:
        assert all(low <= item.values[name] <= high for name, (low, high) in item.intervals.items())
    impossible = Explorer.restore(SPACE, {**explorer.state(), "limits": {"a": 0.1}})
    assert impossible.recommended() == []


@pytest.mark.parametrize("objectives", [1, 3])
def test_one_objective_has_one_recommendation_and_three_a_front(objectives):
    truth = np.stack([TRUTH[:, 0], TRUTH[:, 1], 5.0 + (CODES[:, 1] - 5.0) ** 2], axis=1)[:, :objectives]
    names = [f"y{k}" for k in range(objectives)]
    explorer = measured(np.random.default_rng(1), 0.1, names, truth=truth)
    recommended = explorer.recommended()
    assert (len(recommended) == 1) == (objectives == 1)
    values = np.array([list(item.values.values()) for item in recommended])
    beaten = (values[:, None] >= values).all(axis=2) & (values[:, None] > values).any(axis=2)
    assert not beaten.any()


@pytest.mark.parametrize("shift", [0.0, -40.0])
def test_values_that_are_not_positive_and_constant_ones_are_recommended_like_others(shift):
    explorer = measured(np.random.default_rng(1), 1.0, truth=TRUTH + shift, additive=True)
    assert len(explorer.recommended()) > 2
    constant = measured(np.random.default_rng(1), 0.0, truth=np.zeros_like(TRUTH))
    assert as_measured(constant.recommended()) == constant.front()


def test_a_restored_explorer_recommends_the_same():
    explorer = measured(np.random.default_rng(1), 0.1)
    restored = Explorer.restore(SPACE, json.loads(json.dumps(explorer.state())))
    assert restored.recommended() == explorer.recommended()
    assert restored.state() == explorer.state()
