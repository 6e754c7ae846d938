"""The processes choose what to learn from, and what they learned can be saved."""

import json

import numpy as np
import pytest

from pareto import Explorer
from pareto.fronts.objective import read_objectives
from pareto.search.history import History
from pareto.search.models import Models, read_learned
from pareto.search.targets import Targets
from pareto.search.trend import Trend
from tests.builders.spaces import space_of

SPACE = space_of(x=range(40), y=range(40))


def history_with(leap, count=120):
    """A history of one objective that is smooth everywhere, and one that leaps where x is above 25."""
    rng = np.random.default_rng(5)
    history = History(SPACE, read_objectives(("smooth", "leaps")), {"smooth": 6.0, "leaps": 3.0})
    for index in rng.choice(len(SPACE), count, replace=False).tolist():
        x, y = SPACE.codes([index])[0] / 39
        lost = leap * (1.0 + np.sin(900 * x * y)) if x > 25 / 39 else 0.0
        history.record(index, (float(np.exp(2.5 * x - y + 1)), float(np.exp(0.8 * y - x + 1 + lost))))
    return history


def learned(history, earlier=None):
    targets = Targets.of(history)
    return Models(history, targets, Trend.of(None, targets), 600, np.random.default_rng(0), earlier)


def test_an_objective_that_leaps_is_learned_beside_the_front_and_a_smooth_one_from_everything():
    models = learned(history_with(leap=3.0))
    assert [objective.is_local for objective in models.objectives] == [False, True]
    assert set(models.learned.hyperparameters) == {"0", "1", "1 near", "near"}
    assert set(models.learned.success) == {"near"}
    free = np.arange(0, len(SPACE), 7)
    near = models.at(free).near
    x, y = SPACE.codes(free).T / 39
    lost, inside = x > 26 / 39, (x < 24 / 39) & (0.8 * y - x + 1 < np.log(3.0) - 0.1)
    assert near[lost].mean() < 0.2 < 0.7 < near[inside].mean()


def test_what_leaps_beside_the_front_is_not_part_of_its_process_and_counts_as_failed():
    calm = history_with(leap=3.0, count=300)
    targets = Targets.of(calm)
    near = np.flatnonzero((targets.depth > 0) & (targets.depth < 0.05))
    leaping = near[:: len(near) // 4][:4]
    history = History(SPACE, calm.objectives, calm.limits)
    for row, (index, values) in enumerate(zip(*calm.measured(), strict=True)):
        history.record(int(index), (values[0], values[1] * (1.05 if row in leaping else 1.0)))
    models = learned(history)
    objective = models.objectives[1]
    assert objective.is_local
    assert objective.leapt.tolist() == leaping.tolist()
    _, deviation = objective.local.left_out()
    assert np.median(deviation) < 0.001  # of a logarithm, where they leap by 0.05
    chance = models.at(targets.indices).near
    assert chance[leaping].max() < chance[np.setdiff1d(near, leaping)].mean()


def test_a_local_process_is_never_less_sure_than_its_values_are_spread():
    models = learned(history_with(leap=3.0))
    prediction = models.at(np.arange(40))
    rng = np.random.default_rng(0)
    near = models.targets.near()
    widest = [np.inf, np.std(models.targets.values[near, 1])]
    assert prediction.widest.tolist() == widest
    before = prediction.local_gain(np.empty((0, 2)), rng)
    models.objectives[1].local._scale *= 1e6
    prediction.widest = np.full(2, np.inf)
    without = prediction.local_gain(np.empty((0, 2)), rng)
    prediction.widest = np.array(widest)
    assert prediction.local_gain(np.empty((0, 2)), rng).max() < 3 * before.max() < without.max()


def test_the_overall_gain_counts_where_much_of_what_was_measured_lies_far_from_the_front():
    history = History(SPACE, read_objectives(("a", "b")), {})
    rng = np.random.default_rng(0)
    for index in range(0, 40, 2):  # a front and nothing else
        history.record(index, (1.0 + index, 1.0 / (1.0 + index)))
    models = learned(history)
    assert models.far == 0.0
    assert not models.at(np.arange(40)).overall_gain(models.front, rng).any()
    for index in rng.choice(np.arange(40, len(SPACE)), 180, replace=False).tolist():
        history.record(index, (1000.0 + index, 10.0 + index))
    models = learned(history)
    assert models.far == pytest.approx(np.mean(~models.targets.near()))
    assert models.far > 0.5
    prediction = models.at(np.arange(len(SPACE)))
    # Nothing failed: each point has the chance to be measured that it may count anywhere within the worst.
    assert prediction.measurable.min() == 1.0
    assert (models.targets.worst == models.targets.values.max(axis=0)).all()
    overall = prediction.overall_gain(models.front, rng)
    assert overall.max() > prediction.local_gain(models.front, rng).max()


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
    models = learned(history_with(leap=0.0))
    assert set(models.learned.hyperparameters) == {"0", "1"}
    assert models.learned.success == {}
    assert models.at(np.arange(50)).near.min() == 1.0


def test_what_was_learned_makes_the_same_models_again():
    history = history_with(leap=3.0)
    history.record(77, None)
    first = learned(history)
    success = {name: item.to_dict() for name, item in first.learned.success.items()}
    assert set(success) == {"near", "measurable"}
    saved = {"hyperparameters": first.learned.hyperparameters, "success": success}
    again = learned(history, read_learned(json.loads(json.dumps(saved)), SPACE))
    assert again.learned.hyperparameters == first.learned.hyperparameters
    one, other = (models.at(np.arange(50)) for models in (first, again))
    for mine, theirs in zip(one.local, other.local, strict=True):
        np.testing.assert_allclose(mine.mean, theirs.mean)
        np.testing.assert_allclose(mine.spread, theirs.spread)
    chances = (models.measurable.chance(np.arange(50)) for models in (first, again))
    np.testing.assert_array_equal(*chances)


def test_a_point_that_is_supposed_is_known_from_then_on():
    prediction = learned(history_with(leap=3.0)).at(np.arange(50))
    processes = [*prediction.local, *prediction.overall]
    before = [posterior.spread[7] for posterior in processes]
    expected = [posterior.mean[7] for posterior in prediction.local]
    np.testing.assert_allclose(prediction.suppose(7), expected)
    assert all(posterior.spread[7] < spread for posterior, spread in zip(processes, before, strict=True))


def test_a_limit_far_beyond_all_values_is_none() -> None:
    explorer = Explorer(space_of(x=range(1, 51)), ("a", "b"), {"a": 1e300}, method="random", seed=1)
    configurations = explorer.ask(20)
    explorer.tell(configurations, [{"a": point["x"] - 9.0, "b": -point["x"]} for point in configurations])
    assert np.isinf(Targets.of(explorer.history).limits).all()
