"""What every search method keeps to."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto import Explorer, Objective
from pareto.errors import ConfigurationError, MethodError, ObjectiveError, StateError
from pareto.fronts.front import nondominated
from pareto.search.methods import METHODS
from tests.builders.spaces import space_of
from tests.pairs import pairs
from tests.pareto.searches import OPTIONS, SPACE, advance, explorer_of, measure, repeats_in, spend

every_method = pytest.mark.parametrize("method", sorted(METHODS))


@pytest.mark.slow
@every_method
def test_one_seed_asks_the_same_and_another_does_not(method):
    first, again, other = (explorer_of(method, seed=seed) for seed in (7, 7, 8))
    assert spend(first, 20) == spend(again, 20)
    spend(other, 20)
    assert first.ask(3) == again.ask(3)
    assert [*first.history.results] != [*other.history.results]


@pytest.mark.slow
@every_method
def test_a_restored_explorer_asks_for_the_same_next_batches(method):
    explorer = explorer_of(method, limits={"error": 0.2})
    spend(explorer, 25)
    explorer.ask(3)  # left pending
    restored = Explorer.restore(SPACE, json.loads(json.dumps(explorer.state())))
    assert restored.state() == explorer.state()
    for _ in range(3):
        expected = explorer.ask(4)
        assert restored.ask(4) == expected
        for one in (explorer, restored):
            one.tell(expected, [measure(item) for item in expected])
    assert restored.front() == explorer.front()


@every_method
def test_results_may_come_late_in_any_order_and_in_parts(method):
    explorer = explorer_of(method)
    waiting, again = [], 0
    for _ in range(12):
        proposals = explorer.propose(4)
        again += sum(item.phase == "again" for item in proposals)
        waiting += [item.configuration for item in proposals]
        waiting.reverse()
        now, waiting = waiting[:3], waiting[3:]
        explorer.tell(now, [measure(item) for item in now])
        assert len(waiting) - len({SPACE.encode(item) for item in waiting}) <= again
        assert sorted(map(SPACE.encode, explorer.pending())) == sorted(map(SPACE.encode, waiting))
    explorer.tell(waiting, [measure(item) for item in waiting])
    if method != "algorithm1":
        assert len(explorer.history.results) == 48 - again
    assert again <= 2
    assert explorer.pending() == []


@every_method
def test_failures_are_taken_even_when_everything_fails(method):
    explorer = explorer_of(method)
    asked = spend(explorer, 30, measure=lambda _: None)
    assert len(asked) == (12 if method == "algorithm1" else 30)
    assert explorer.front() == []
    assert len(explorer.history.failed()) == len(asked)


@every_method
def test_constant_objectives_break_nothing(method):
    explorer = explorer_of(method)
    spend(explorer, 40, measure=lambda _: {"error": 0.0, "seconds": 1.0})
    assert len(explorer.front()) == len(explorer.history.results)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "objectives", "fails"),
    pairs(sorted(METHODS), [("error", "seconds"), ("error", "seconds", "watts")], [0, 5]),
)
def test_the_whole_space_can_be_exhausted(method, objectives, fails):
    space = space_of(x=range(1, 16))
    explorer = explorer_of(method, objectives=objectives, space=space)

    def all_on_the_front(configuration):
        x = configuration["x"]
        return None if x <= fails else {"error": float(x), "seconds": 1.0 / x, "watts": 3.0 + x % 3}

    asked = spend(explorer, 99, measure=all_on_the_front)
    assert repeats_in(asked, space) <= 2 * (method == "bayesian")
    if method != "algorithm1" or not fails:
        assert {item["x"] for item in asked} == set(range(1, 16))
    assert explorer.finished
    assert explorer.ask(5) == []


@pytest.mark.slow
@every_method
@pytest.mark.parametrize("objectives", [("error",), ("error", "seconds", "size")])
def test_any_number_of_objectives(method, objectives):
    explorer = explorer_of(method, objectives=objectives)

    def with_size(configuration):
        values = measure(configuration)
        return values and {**values, "size": configuration["size"]}

    spend(explorer, 30, measure=with_size)
    results = [with_size(SPACE.decode(index)) for index in explorer.history.results]
    points = np.array([[values[name] for name in objectives] for values in results if values])
    found = np.array([[values[name] for name in objectives] for _, values in explorer.front()])
    np.testing.assert_allclose(np.unique(found, axis=0), np.unique(points[nondominated(points)], axis=0))


@every_method
def test_a_maximised_objective_is_the_minimised_one_upside_down(method):
    def rate(configuration):
        values = measure(configuration)
        return values and {"error": values["error"], "rate": 1.0 / values["seconds"]}

    objectives = ("error", Objective("rate", maximise=True))
    explorer = explorer_of(method, objectives=objectives, limits={"rate": 0.1})
    spend(explorer, 60, measure=rate)
    front = explorer.front()
    assert all(values["rate"] >= 0.1 for _, values in front)
    errors = [values["error"] for _, values in front]
    rates = [values["rate"] for _, values in front]
    assert errors == sorted(errors)
    assert rates == sorted(rates)


@every_method
def test_values_from_elsewhere_are_welcome(method):
    explorer = explorer_of(method)
    known = [SPACE.decode(index) for index in range(0, 200, 7)]
    explorer.tell(known, [measure(item) for item in known], phase="imported")
    known_again = [item for item in spend(explorer, 20) if item in known]
    assert len(known_again) == 2 * (method == "bayesian")  # to learn the noise
    assert explorer.history.phases[7] == "imported"


@every_method
def test_proposals_name_their_phase(method):
    explorer = explorer_of(method)
    phases = []
    for _ in range(6):
        phases += [item.phase for item in advance(explorer, 6, lambda item: measure(item.configuration))]
    assert set(phases) <= {"random", "active", "again"}
    assert phases.count("again") == 2 * (method == "bayesian")
    assert phases[0] == "random"
    assert ("active" in phases) == (method != "random")


def test_repeats_ask_for_the_front_again_and_average():
    explorer = explorer_of("random")
    spend(explorer, 40)
    front = [configuration for configuration, _ in explorer.front()]
    again = explorer.ask(3, repeats=True)
    assert len(again) == 3
    assert all(configuration in front for configuration in again)
    before = dict(explorer.history.results)
    explorer.tell(again, [{"error": 9.0, "seconds": 9.0}, None, {"error": 9.0, "seconds": 9.0}])
    index = SPACE.encode(again[0])
    once = before[index][0]
    indices, values = explorer.history.measured()
    assert values[list(indices).index(index)] == pytest.approx([(once[0] + 9) / 2, (once[1] + 9) / 2])
    assert SPACE.encode(again[1]) not in explorer.history.failed()


def test_taking_back_what_nobody_will_measure_lets_it_be_asked_again():
    explorer = explorer_of("random")
    asked = explorer.ask(len(SPACE))
    assert explorer.ask(1) == []
    explorer.forget(asked[:2])
    assert sorted(map(SPACE.encode, explorer.ask(5))) == sorted(map(SPACE.encode, asked[:2]))


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(SPACE) - 1), st.integers(1, 9), st.integers(1, 9)), max_size=40))
def test_the_front_is_the_non_dominated_part_of_the_measurements_within_limits(measurements):
    explorer = Explorer(SPACE, ("a", "b"), {"a": 7}, method="random")
    last = {index: (a, b) for index, a, b in measurements}
    explorer.tell([SPACE.decode(index) for index in last], [{"a": a, "b": b} for a, b in last.values()])
    points = np.array([values for values in last.values() if values[0] <= 7], dtype=float).reshape(-1, 2)
    expected = sorted(map(tuple, points[nondominated(points)]))
    assert [(values["a"], values["b"]) for _, values in explorer.front()] == expected


def test_bad_results_are_refused_and_none_of_the_batch_is_taken():
    explorer = explorer_of("random")
    good, bad = explorer.ask(2)
    for values, message in [
        ({"error": 1.0}, "'seconds' is missing"),
        ({"error": float("nan"), "seconds": 1.0}, "nan"),
        ({"error": "1", "seconds": 1.0}, "'1'"),
        ({"error": True, "seconds": 1.0}, "True"),
        (3.0, "3.0"),
    ]:
        with pytest.raises(ObjectiveError, match=message):
            explorer.tell([good, bad], [measure(good), values])
    with pytest.raises(ConfigurationError, match="'sise'"):
        explorer.tell([good, {"sise": 1}], [measure(good), None])
    assert explorer.history.results == {}


def test_wrong_objectives_limits_methods_and_options_are_named():
    for arguments, error, message in [
        ({"objectives": "error"}, ObjectiveError, "list of names"),
        ({"objectives": ()}, ObjectiveError, "one or more"),
        ({"objectives": ("a", "a")}, ObjectiveError, "different"),
        ({"objectives": ("a",), "limits": {"b": 1}}, ObjectiveError, "'b'"),
        ({"objectives": ("a",), "limits": {"a": "low"}}, ObjectiveError, "'low'"),
        ({"objectives": ("a",), "limits": {"a": float("inf")}}, ObjectiveError, "leave the limit out"),
        ({"objectives": ("a",), "method": "annealing"}, MethodError, "bayesian, algorithm1, random"),
        ({"objectives": ("a",), "method": "algorithm1", "forests": 3}, MethodError, "initial, trees"),
        ({"objectives": ("a",), "initial": 0}, MethodError, "from 1 to 1,000,000"),
        ({"objectives": ("a",), "initial": 10**11}, MethodError, "from 1 to 1,000,000, not 100000000000"),
    ]:
        with pytest.raises(error, match=message):
            Explorer(SPACE, **arguments)


def test_a_state_of_another_space_version_or_shape_is_refused():
    state = explorer_of("random").state()
    with pytest.raises(StateError, match="another space"):
        Explorer.restore(space_of(x=bool), state)
    with pytest.raises(StateError, match="version 99"):
        Explorer.restore(SPACE, {**state, "version": 99})
    with pytest.raises(StateError, match="observations"):
        Explorer.restore(SPACE, {key: value for key, value in state.items() if key != "observations"})


@every_method
def test_the_number_of_random_configurations_is_an_option_of_every_method(method):
    options = {**OPTIONS[method], "initial": 30, "budget": 1}
    explorer = Explorer(SPACE, ("error", "seconds"), method=method, **options)
    proposals = explorer.propose(30)
    assert [proposal.phase for proposal in proposals] == ["random"] * 30
