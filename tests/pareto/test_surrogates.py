"""The processes choose what to learn from, and what they know can be saved."""

import json

import numpy as np

from pareto import Space
from pareto.history import History
from pareto.objective import read_objectives
from pareto.surrogates import BOLD, CAUTIOUS, Surrogates
from pareto.targets import Targets
from pareto.transfer import Trend

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


def test_an_objective_that_leaps_is_learnt_from_what_is_in_reach_and_a_smooth_one_from_everything():
    surrogates = learnt(known(leap=3.0))
    assert {name: recipe["reach"] for name, recipe in surrogates.recipes.items()} == {
        "0": False,
        "1": True,
        "1 of all values": False,
        "success": False,
    }
    free = np.arange(0, len(SPACE), 7)
    promise = surrogates.at(free)
    x, y = SPACE.codes(free).T / 39
    lost, inside = x > 26 / 39, (x < 24 / 39) & (0.8 * y - x + 1 < np.log(3.0) - 0.1)
    assert promise.chance[BOLD, lost].mean() < 0.3 < 0.7 < promise.chance[BOLD, inside].mean()
    assert (promise.chance[CAUTIOUS] <= promise.chance[BOLD]).all()
    assert promise.chance[CAUTIOUS, lost].mean() < promise.chance[CAUTIOUS, inside].mean()


def test_a_process_of_what_is_in_reach_is_never_less_sure_than_its_values_are_spread():
    surrogates = learnt(known(leap=3.0))
    promise = surrogates.at(np.arange(40))
    reference, rng = surrogates.targets.reference, np.random.default_rng(0)
    inside = surrogates.targets.within_reach()[:, 1]
    assert promise.widest.tolist() == [np.inf, np.std(surrogates.targets.values[inside, 1])]
    before = promise.gain(np.empty((0, 2)), reference, rng)
    promise.objectives[1]._scale *= 1e6
    promise.widest = np.full(2, np.inf)
    without = promise.gain(np.empty((0, 2)), reference, rng)
    promise.widest = surrogates.at(np.arange(40)).widest
    assert promise.gain(np.empty((0, 2)), reference, rng).max() < 3 * before.max() < without.max()


def test_without_a_leap_nothing_counts_as_a_failure():
    surrogates = learnt(known(leap=0.0))
    assert surrogates.recipes["0"]["reach"] is False
    assert surrogates.at(np.arange(50)).chance.min() > 0.5


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
