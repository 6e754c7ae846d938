"""The processes choose what to learn from, and what they know can be saved."""

import json

import numpy as np
import pytest

from pareto import Space
from pareto.fronts.objective import read_objectives
from pareto.search.history import History
from pareto.search.models import BESIDE, BOLD, CAUTIOUS, ENDS, WIDE, Surrogates
from pareto.search.targets import Targets
from pareto.search.transfer import Trend

SPACE = Space.from_dict(
    {
        "parameters": [
            {"name": "x", "type": "integer", "minimum": 0, "maximum": 39},
            {"name": "y", "type": "integer", "minimum": 0, "maximum": 39},
        ]
    }
)


def known(leap, count=120):
    """A history of one objective that is smooth everywhere, and one that leaps where x is above 25."""
    rng = np.random.default_rng(5)
    history = History(SPACE, read_objectives(("smooth", "leaps")), {"smooth": 6.0, "leaps": 3.0})
    for index in rng.choice(len(SPACE), count, replace=False).tolist():
        x, y = SPACE.codes([index])[0] / 39
        lost = leap * (1.0 + np.sin(900 * x * y)) if x > 25 / 39 else 0.0
        history.record(index, (float(np.exp(2.5 * x - y + 1)), float(np.exp(0.8 * y - x + 1 + lost))))
    return history


def learnt(history, recipes=None):
    targets = Targets.of(history)
    rng = np.random.default_rng(0)
    return Surrogates(history, targets, Trend.of(history, targets), 600, rng, recipes)


def test_an_objective_that_leaps_is_learnt_beside_the_front_and_a_smooth_one_from_everything():
    surrogates = learnt(known(leap=3.0))
    assert set(surrogates.recipes) == {"0", "1", "1 near", "success"}
    free = np.arange(0, len(SPACE), 7)
    promise = surrogates.at(free)
    x, y = SPACE.codes(free).T / 39
    lost, inside = x > 26 / 39, (x < 24 / 39) & (0.8 * y - x + 1 < np.log(3.0) - 0.1)
    assert promise.chance[BOLD, lost].mean() < 0.2 < 0.7 < promise.chance[BOLD, inside].mean()


def test_what_leaps_beside_the_front_is_no_part_of_its_process_and_counts_as_failed():
    calm = known(leap=3.0, count=300)
    targets = Targets.of(calm)
    near = np.flatnonzero((targets.depth > 0) & (targets.depth < 0.05))
    leaping = near[:: len(near) // 4][:4]
    history = History(SPACE, calm.objectives, calm.limits)
    for row, (index, values) in enumerate(zip(*calm.measured(), strict=True)):
        history.record(int(index), (values[0], values[1] * (1.05 if row in leaping else 1.0)))
    surrogates = learnt(history)
    process = surrogates._objectives[1]
    assert "1 near" in surrogates.recipes
    assert process.leapt.tolist() == leaping.tolist()
    assert process.process.doubt() < 0.001  # of a logarithm, where they leap by 0.05
    indices = targets.indices
    chance = surrogates.at(indices).chance[BOLD]
    assert chance[leaping].max() < chance[np.setdiff1d(near, leaping)].mean()


def test_a_near_process_is_asked_where_it_knows_and_by_one_opinion_only_beside_the_front():
    surrogates = learnt(known(leap=3.0))
    free = np.arange(len(SPACE))
    promise = surrogates.at(free)
    doubtful = promise.objectives[1].spread > surrogates._objectives[1].trusted
    assert 0 < doubtful.sum() < len(free)
    assert (promise.chance[CAUTIOUS, doubtful] == 0).all()
    assert (promise.chance[CAUTIOUS, ~doubtful] == promise.chance[BOLD, ~doubtful]).all()
    front = surrogates.targets.indices[surrogates.targets.front]
    steps = SPACE.codes(free)[:, None] != SPACE.codes(front)
    beside = (steps.sum(axis=2) == 1).any(axis=1)
    assert (promise.chance[BESIDE] == np.where(beside, promise.chance[CAUTIOUS], 0.0)).all()


def test_a_near_process_is_never_less_sure_than_its_values_are_spread():
    surrogates = learnt(known(leap=3.0))
    promise = surrogates.at(np.arange(40))
    rng = np.random.default_rng(0)
    near = surrogates.targets.near()
    assert promise.widest.tolist() == [np.inf, np.std(surrogates.targets.values[near, 1])]
    before = promise.gain(BOLD, np.empty((0, 2)), rng)
    promise.objectives[1]._scale *= 1e6
    promise.widest = np.full(2, np.inf)
    without = promise.gain(BOLD, np.empty((0, 2)), rng)
    promise.widest = surrogates.at(np.arange(40)).widest
    assert promise.gain(BOLD, np.empty((0, 2)), rng).max() < 3 * before.max() < without.max()


def test_a_gain_is_the_same_asked_for_alone_or_with_all_others():
    surrogates = learnt(known(leap=3.0))
    front = surrogates.targets.values[surrogates.targets.front]
    promise = surrogates.at(np.arange(len(SPACE)))
    gains = promise.gains(front, np.random.default_rng(0))
    for opinion in (CAUTIOUS, BOLD, BESIDE, ENDS, WIDE):
        np.testing.assert_array_equal(gains[opinion], promise.gain(opinion, front, np.random.default_rng(0)))


def test_the_wide_opinion_speaks_where_much_of_what_was_measured_lies_far_from_the_front():
    history = History(SPACE, read_objectives(("a", "b")), {})
    rng = np.random.default_rng(0)
    for index in range(0, 40, 2):  # a front and nothing else
        history.record(index, (1.0 + index, 1.0 / (1.0 + index)))
    surrogates = learnt(history)
    assert surrogates.far == 0.0
    assert surrogates.at(np.arange(40)).chance[WIDE].max() == 0.0
    for index in rng.choice(np.arange(40, len(SPACE)), 180, replace=False).tolist():
        history.record(index, (1000.0 + index, 10.0 + index))
    surrogates = learnt(history)
    assert surrogates.far == pytest.approx(np.mean(~surrogates.targets.near()))
    assert surrogates.far > 0.5
    promise = surrogates.at(np.arange(len(SPACE)))
    # Nothing failed: each point has the chance to be measured that it may count anywhere within the worst.
    assert promise.chance[WIDE].min() == 1.0
    assert (surrogates.targets.worst == surrogates.targets.values.max(axis=0)).all()
    gains = promise.gains(surrogates.targets.values[surrogates.targets.front], rng)
    assert gains[WIDE].max() > gains[BOLD].max()


def test_depth_is_what_a_point_must_improve_by_before_it_counts():
    values = [(1.0, 4.0), (2.0, 2.0), (4.0, 1.0), (3.0, 3.0), (2.5, 7.0), (9.0, 0.5)]
    history = History(SPACE, read_objectives(("a", "b")), {"a": np.exp(5.0), "b": np.exp(5.0)})
    for index, pair in enumerate(values):
        history.record(index, tuple(np.exp(pair)))
    targets = Targets.of(history)
    assert sorted(targets.front) == [0, 1, 2]
    # The extent, limits included, is 4 in both. (3, 3) is one behind (2, 2); the last two break a limit.
    np.testing.assert_allclose(targets.depth, [0.0, 0.0, 0.0, 0.25, 0.5, 1.0])
    assert targets.near().tolist() == [True, True, True, True, False, False]


def test_without_limits_the_reference_comes_nearer_as_more_is_known():
    def reference(count):
        history = History(SPACE, read_objectives(("a", "b")), {})
        for index in range(count):
            pair = {0: (0.0, 1.0), 1: (1.0, 0.0)}.get(index, (0.9, 0.9))
            history.record(index, tuple(np.exp(pair)))
        return Targets.of(history).reference.tolist()

    assert reference(20) == reference(40) == [1.5, 1.5]
    np.testing.assert_allclose(reference(80), 1.25)
    np.testing.assert_allclose(reference(1000), 1.1)


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_without_limits_a_front_counts_as_far_as_it_is_worth_its_price(unit):
    """Whatever an objective's own extent is: an accuracy may vary by a hundredth of what a time does."""

    def targets(last):
        history = History(SPACE, read_objectives(("a", "b")), {})
        for index, (a, b) in enumerate([(0.0, 1.0), (1.0, 0.0), (0.5, 0.9), (3.0, last)]):
            history.record(index, (float(np.exp(a)), float(np.exp(unit * b))))
        return Targets.of(history)

    # Two more in the first objective, for a hundredth less in the second or for a half.
    np.testing.assert_allclose(targets(-0.01).reference, [1.5, 1.5 * unit])
    np.testing.assert_allclose(targets(-0.5).reference, [4.5, 1.75 * unit])
    assert targets(-0.01).front.tolist() == [0, 1, 2]


def test_without_a_leap_nothing_counts_as_a_failure():
    surrogates = learnt(known(leap=0.0))
    assert set(surrogates.recipes) == {"0", "1"}
    assert surrogates.at(np.arange(50)).chance[BOLD].min() == 1.0


def test_recipes_make_the_same_models_again():
    history = known(leap=3.0)
    first = learnt(history)
    again = learnt(history, json.loads(json.dumps(first.recipes)))
    assert again.recipes == first.recipes
    for one, other in zip(
        first.at(np.arange(50)).objectives, again.at(np.arange(50)).objectives, strict=True
    ):
        np.testing.assert_allclose(one.mean, other.mean)
        np.testing.assert_allclose(one.spread, other.spread)


def test_a_point_that_is_supposed_is_known_from_then_on():
    promise = learnt(known(leap=3.0)).at(np.arange(50))
    before = [posterior.spread[7] for posterior in promise.objectives]
    expected = [posterior.mean[7] for posterior in promise.objectives]
    np.testing.assert_allclose(promise.suppose(7), expected)
    assert all(
        posterior.spread[7] < spread for posterior, spread in zip(promise.objectives, before, strict=True)
    )
