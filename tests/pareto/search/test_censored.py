"""A value that is known to be this or worse: kept as that, never recommended, and learned from."""

import json
import pickle
import warnings

import numpy as np
import pytest

from pareto import Censored, Explorer, Objective
from pareto.errors import DamagedStateError, NothingFeasibleError, ObjectiveError
from pareto.fronts.front import nondominated
from pareto.fronts.hypervolume import hypervolume
from pareto.fronts.objective import read_objectives
from pareto.search.history import History
from pareto.search.models import Models
from pareto.search.noise import Noise
from pareto.search.prior import Prior
from pareto.search.repeats import repeat_gains
from pareto.search.targets import Targets
from pareto.search.trend import Trend
from pareto.surrogates.gaussian import GaussianProcess
from pareto.surrogates.truncated import truncated_mean
from tests.builders.spaces import space_of
from tests.pareto.searches import SPACE, explorer_of, measure, spend

PLANE = space_of(x=range(40), y=range(40))
LIMIT = 2.0
METHODS = ("bayesian", "algorithm1", "random")


def plane_values(index):
    """Error and time of a point of the plane; the error is within LIMIT in about a third of it."""
    x, y = PLANE.codes([index])[0] / 39
    error = float(np.exp(2.0 * (x - 0.2) ** 2 + 2.5 * y * y + 0.4 * np.sin(6 * x * y)))
    return error, float(np.exp(1.0 - x - 0.8 * y))


EVERYTHING = np.array([plane_values(index) for index in range(len(PLANE))])


def bound(value, index):
    """Where a measurement beyond LIMIT ends: somewhere between the limit and the value."""
    return LIMIT + (value - LIMIT) * np.random.default_rng(index).uniform(0, 0.3)


def plane_search(ended, seed, budget=60):
    """The indices of a search; `ended` makes the value that is reported beyond LIMIT."""
    explorer = Explorer(
        PLANE, ("error", "time"), {"error": LIMIT}, seed=seed, initial=20, candidates=500, points=200
    )
    while len(explorer.history.results) < budget and (proposals := explorer.propose(8)):
        for proposal in proposals:
            error, time = plane_values(proposal.index)
            reported = error if error <= LIMIT else ended(error, proposal.index)
            explorer.tell([proposal.configuration], [{"error": reported, "time": time}])
    return [*explorer.history.results][:budget]


def regret(indices):
    point = np.array([LIMIT, EVERYTHING[:, 1].max()])
    best = EVERYTHING[nondominated(EVERYTHING)]
    return 1.0 - hypervolume(EVERYTHING[indices], point, log=True) / hypervolume(best, point, log=True)


def plane_history(indices, censored=True):
    history = History(PLANE, read_objectives(("error", "time")), {"error": LIMIT})
    for index in indices:
        error, time = plane_values(index)
        if censored and error > LIMIT:
            error = Censored(bound(error, index))
        history.record(index, (error, time))
    return history


def learned(history):
    targets = Targets.of(history)
    return Models(history, targets, Trend.of(None, targets), 600, np.random.default_rng(0))


def test_a_censored_value_is_the_number_of_its_bound():
    value = Censored(0.08)
    assert value == 0.08
    assert repr(value) == "Censored(0.08)"
    assert isinstance(pickle.loads(pickle.dumps(value)), Censored)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_bound_is_a_finite_number(value):
    explorer = explorer_of("random")
    with pytest.raises(ObjectiveError, match="error = Censored"):
        explorer.tell([SPACE.default], [{"error": Censored(value), "seconds": 1.0}])


@pytest.mark.parametrize("method", METHODS)
def test_censored_values_are_saved_and_restored_as_censored(method):
    def ended(configuration):
        values = measure(configuration)
        if values and values["error"] > 0.12:
            values["error"] = Censored(0.12)
        return values

    explorer = explorer_of(method, limits={"error": 0.1})
    spend(explorer, 40, measure=ended)
    state = json.loads(json.dumps(explorer.state(), allow_nan=False))
    saved = [value for _, _, rows in state["observations"] for values in rows if values for value in values]
    assert {"censored": 0.12} in saved
    other = Explorer.restore(SPACE, state)
    np.testing.assert_array_equal(other.history.censored(), explorer.history.censored())
    assert other.history.censored().any(axis=0).tolist() == [True, False]
    assert other.state() == explorer.state()
    assert other.propose(5) == explorer.propose(5)


@pytest.mark.parametrize("value", [{"censored": "much"}, {"censored": None}, {"above": 0.1}, {}])
def test_a_damaged_bound_is_a_damaged_state(value):
    explorer = explorer_of("random")
    explorer.tell([SPACE.default], [{"error": 0.1, "seconds": 1.0}])
    state = explorer.state()
    state["observations"][0][2] = [[value, 1.0]]
    with pytest.raises(DamagedStateError):
        Explorer.restore(SPACE, state)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("maximise", [False, True])
def test_a_censored_value_is_never_on_the_front_or_recommended(method, maximise):
    explorer = explorer_of(method, (Objective("error", maximise), "seconds"))
    best = -5.0 if not maximise else 5.0
    configurations = explorer.ask(6)
    results = [{"error": 1.0 + number, "seconds": 9.0 - number} for number in range(5)]
    explorer.tell(configurations, [*results, {"error": Censored(best), "seconds": 0.1}])
    assert configurations[5] not in [configuration for configuration, _ in explorer.front()]
    assert configurations[5] not in [item.configuration for item in explorer.recommended()]
    assert explorer.answer() == explorer.front() != []
    explorer.ask(4)


def test_only_the_models_of_a_censored_objective_are_others():
    chosen = np.random.default_rng(4).choice(len(PLANE), 80, replace=False).tolist()
    some, all_values = learned(plane_history(chosen)), learned(plane_history(chosen, censored=False))
    censored, full = (models.objectives[0].overall for models in (some, all_values))
    assert (np.sort(censored.targets) != np.sort(full.targets)).any()
    censored, full = (models.objectives[1].overall for models in (some, all_values))
    np.testing.assert_array_equal(censored.targets, full.targets)


def test_the_mean_of_repeats_is_censored_where_one_is():
    explorer = explorer_of("bayesian")
    explorer.budget = 8
    rest = [{"error": 5.0 + number, "seconds": 5.0 + number} for number in range(7)]
    explorer.tell(explorer.ask(8), [{"error": 0.1, "seconds": 1.0}, *rest])
    first = explorer.front()[0][0]
    explorer.tell([first], [{"error": Censored(0.3), "seconds": 1.0}])
    _, values = explorer.history.measured()
    assert values[0].tolist() == pytest.approx([0.2, 1.0])
    assert explorer.history.censored()[0].tolist() == [True, False]
    assert first not in [configuration for configuration, _ in explorer.front()]
    assert first not in explorer.ask(3, repeats=True)


def test_noise_is_known_from_measurements_without_bounds_only():
    history = plane_history(range(0, 1600, 40), censored=False)
    for value in (Censored(1.0), Censored(9.0)):
        history.record(0, (value, 1.0))
    assert Noise.of(history, Targets.of(history)).repeats == 0
    error, time = plane_values(0)
    history.record(0, (error * 1.1, time))
    noise = Noise.of(history, Targets.of(history))
    assert noise.repeats == 1
    np.testing.assert_allclose(noise.variance[0], [np.log(1.1) ** 2 / 2, 0.0])


def test_where_there_is_noise_no_repeat_is_asked_of_a_censored_configuration():
    rng = np.random.default_rng(1)
    history = plane_history(rng.choice(len(PLANE), 60, replace=False).tolist())
    exact = history.measured()[0][history.exact()]
    for index in exact[:10].tolist():
        error, time = plane_values(index)
        history.record(index, (error * float(rng.uniform(0.9, 1.1)), time))
    models = learned(history)
    assert models.noise
    gains = repeat_gains(models, [], rng)
    assert gains.max() > 0
    assert not gains[~models.targets.exact].any()
    assert len(models.front) == len(models.targets.front_of(models.estimates[0]))


def test_a_censored_point_is_not_near_the_front_and_not_the_nearest_miss():
    history = History(PLANE, read_objectives(("a", "b")), {"a": 1.0})
    for index, values in enumerate([(3.0, 3.0), (4.0, 2.0), (Censored(1.01), 1.0), (Censored(0.5), 1.0)]):
        history.record(index, values)
    targets = Targets.of(history)
    assert targets.limits[0] == pytest.approx(np.log(3.0))
    assert targets.front.tolist() == [0]
    assert targets.near().tolist() == [True, False, False, False]
    assert targets.whole_front.tolist() == targets.values[:2].tolist()


def test_where_all_values_are_censored_there_is_no_answer_and_the_search_goes_on():
    for limits in ({}, {"error": 0.1}):
        explorer = explorer_of("bayesian", limits=limits)
        for _ in range(6):
            batch = explorer.ask(5)
            explorer.tell(batch, [{"error": Censored(0.2), "seconds": 1.0 + item["size"]} for item in batch])
        assert explorer.front() == []
        assert explorer.recommended() == []
        with pytest.raises(NothingFeasibleError, match="each of 30 measured configurations"):
            explorer.answer()
        assert len(explorer.ask(5)) == 5


def test_the_mean_beyond_a_bound_is_that_of_many_draws():
    draws = np.random.default_rng(0).normal(1.0, 2.0, 1_000_000)
    bounds = np.array([-4.0, 0.0, 1.0, 3.0, 5.0])
    expected = [draws[draws >= bound].mean() for bound in bounds]
    np.testing.assert_allclose(truncated_mean(np.ones(5), np.full(5, 2.0), bounds), expected, rtol=5e-3)


def test_far_in_a_tail_the_mean_beyond_a_bound_is_a_number():
    bounds = np.array([-1e300, -1e4, 10.0, 40.0, 1e4, 1e300])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        means = truncated_mean(np.zeros(6), np.ones(6), bounds)
    assert means[:2].tolist() == [0.0, 0.0]
    # E[X - bound] is 1 / bound less terms of the third order.
    np.testing.assert_allclose(means[2:4] - bounds[2:4], 1 / bounds[2:4], rtol=0.02)
    assert (means >= bounds).all()


def test_an_imputed_value_is_beyond_its_bound_and_near_the_truth():
    rng = np.random.default_rng(4)
    chosen = rng.choice(len(PLANE), 150, replace=False)
    truth = np.log([plane_values(int(index))[0] for index in chosen])
    censored = truth > np.log(LIMIT)
    measured, beyond = PLANE.features(chosen[~censored]), PLANE.features(chosen[censored])
    process = GaussianProcess.fit(measured, truth[~censored], PLANE.feature_owner, rng)
    bounds = np.full(len(beyond), np.log(LIMIT))
    extended = process.with_censored(beyond, bounds, np.full(len(beyond), np.inf))
    np.testing.assert_array_equal(extended.targets[: len(measured)], truth[~censored])
    imputed = extended.targets[len(measured) :]
    assert (imputed >= bounds).all()
    error, before = (np.abs(values - truth[censored]) for values in (imputed, bounds))
    assert error.mean() < 0.5 * before.mean()
    assert error[before < 0.3].max() < 0.15
    np.testing.assert_array_equal(extended.theta, process.theta)
    capped = process.with_censored(beyond, bounds, bounds)
    np.testing.assert_array_equal(capped.targets[len(measured) :], bounds)


def test_models_expect_more_of_a_censored_region_than_its_bounds():
    chosen = np.random.default_rng(4).choice(len(PLANE), 150, replace=False).tolist()
    models = learned(plane_history(chosen))
    targets = models.targets
    censored = targets.censored[:, 0]
    assert 20 < censored.sum() < 130
    learned_from = np.empty(len(censored))
    rows = np.argsort(censored, kind="stable")  # a process has the bounds last
    learned_from[rows] = models.objectives[0].overall.targets
    assert (learned_from >= targets.values[:, 0]).all()
    assert (learned_from[censored] > targets.values[censored, 0]).mean() > 0.9
    assert (learned_from[~censored] == targets.values[~censored, 0]).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in (1, 2))])
def test_a_search_with_censored_values_finds_nearly_what_one_with_all_values_does(seed):
    full = regret(plane_search(lambda value, _: value, seed))
    ended = regret(plane_search(lambda value, index: Censored(bound(value, index)), seed))
    assert ended < full + 0.02 < 0.1


def test_a_prior_tries_no_censored_configuration_first():
    pairs = [
        (PLANE.decode(index), {"error": value, "time": 1.0})
        for index, value in enumerate([3.0, Censored(0.1), 2.0])
    ]
    prior = Prior.read(PLANE, read_objectives(("error", "time")), {}, pairs)
    assert prior.ranked(5).tolist() == [2, 0]
    explorer = Explorer(PLANE, ("error", "time"), prior=pairs)
    assert explorer.state()["prior"][1][2] == [[{"censored": 0.1}, 1.0]]
    assert Explorer.restore(PLANE, explorer.state()).state() == explorer.state()


def test_a_frame_says_which_values_are_bounds_and_gives_them_back():
    explorer = explorer_of("random")
    results = [{"error": Censored(0.3), "seconds": 1.0}, None, {"error": 1.0, "seconds": 2.0}]
    explorer.tell(explorer.ask(3), results)
    frame = explorer.evaluations_frame()
    assert frame["error"].dtype == "float64"
    assert frame["censored"].tolist() == ["error", "", ""]
    other = explorer_of("random")
    other.tell_frame(frame)
    assert other.history.results == explorer.history.results
    np.testing.assert_array_equal(other.history.censored(), [[True, False], [False, False]])
    assert "censored" not in explorer.front_frame()
    with pytest.raises(ObjectiveError, match="censored is 'erorr'"):
        other.tell_frame(frame.assign(censored=["erorr", "", ""]))
