"""A measurement ends early where what it reports is beyond a limit, or behind a finished point."""

import pytest

from pareto import Censored, Objective
from pareto.errors import ObjectiveError
from tests.pareto.searches import SPACE, explorer_of


def measured(objectives=("error", "seconds"), limits=None, noise=0.0):
    """An explorer that knows two finished points, the second of them measured twice."""
    explorer = explorer_of("random", objectives, limits)
    first, second = explorer.ask(2)
    explorer.tell([first, second], [{"error": 0.1, "seconds": 4.0}, {"error": 0.2, "seconds": 2.0}])
    explorer.tell([second], [{"error": 0.2, "seconds": 2.0 * (1 + noise)}])
    return explorer


def new_proposal(explorer):
    return next(item for item in explorer.propose(3) if item.configuration != SPACE.default)


def test_a_bound_beyond_a_limit_ends_a_measurement_with_values_to_tell():
    explorer = explorer_of("random", limits={"error": 0.05})
    trial = new_proposal(explorer)
    assert trial.report({"error": 0.05}, {"seconds": 3.0}) is None
    stop = trial.report({"error": 0.06}, {"seconds": 3.0})
    assert stop.reason == "stopped early: error 0.06 (beyond 0.05)"
    assert stop.values == {"error": 0.06, "seconds": 3.0}
    assert [type(stop.values[name]) for name in ("error", "seconds")] == [Censored, float]
    explorer.tell([trial.configuration], [stop.values])
    assert explorer.history.censored().tolist() == [[True, False]]


def test_a_measurement_that_has_not_reported_all_objectives_ends_as_a_failure():
    trial = new_proposal(explorer_of("random", limits={"error": 0.05}))
    assert trial.report({"error": 0.06}).values is None


def test_an_estimate_ends_a_measurement_only_where_it_is_far_beyond():
    trial = new_proposal(explorer_of("random", limits={"seconds": 1.0}))
    assert trial.report({}, {"seconds": 1.05}) is None
    assert trial.report({}, {"seconds": 1.06}) is not None


def test_a_measurement_ends_behind_a_finished_point_in_all_objectives():
    trial = new_proposal(measured())
    assert trial.report({"error": 0.21, "seconds": 2.1}) is not None
    assert trial.report({"error": 0.21, "seconds": 1.9}) is None
    assert trial.report({"error": 0.11, "seconds": 3.9}) is None  # before one, and behind none
    assert trial.report({"error": 0.21}) is None


def test_a_measurement_must_be_slower_by_more_than_the_noise():
    trial = new_proposal(measured(noise=0.05))  # a deviation of 3.5 %: a difference of 9.6 % is more
    assert trial.report({"error": 0.21, "seconds": 2.15}) is None
    assert trial.report({"error": 0.21, "seconds": 2.35}) is not None


def test_while_noise_is_unknown_only_limits_end_a_measurement():
    explorer = explorer_of("random")
    explorer.tell([SPACE.default], [{"error": 0.1, "seconds": 1.0}])
    assert new_proposal(explorer).report({"error": 9.0, "seconds": 9.0}) is None


def test_a_maximised_objective_ends_a_measurement_from_below():
    explorer = explorer_of("random", (Objective("error", maximise=True), "seconds"), {"error": 5.0})
    trial = new_proposal(explorer)
    assert trial.report({"error": 5.1}) is None
    assert trial.report({"error": 4.9}) is not None
    assert trial.report({}, {"error": 4.9}) is None
    assert trial.report({}, {"error": 4.5}) is not None


def test_the_default_and_what_is_measured_again_run_to_their_end():
    explorer = measured(limits={"error": 0.15})
    [again] = explorer.ask(1, repeats=True)
    assert explorer.stop_conditions(again) == []
    assert explorer.stop_conditions(SPACE.default) == []
    assert explorer.stop_conditions(SPACE.decode(3))[0] == {"error": 0.15}


@pytest.mark.parametrize("bad", [{"errors": 1.0}, {"error": float("nan")}, {"error": "much"}])
def test_a_report_of_anything_but_numbers_of_objectives_is_an_error(bad):
    trial = new_proposal(explorer_of("random", limits={"error": 0.05}))
    with pytest.raises(ObjectiveError, match="error"):
        trial.report(bad)
