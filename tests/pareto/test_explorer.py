"""What every search method keeps to, and what each one is for."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto import Explorer, Objective, Space
from pareto.errors import ConfigurationError, MethodError, ObjectiveError, StateError
from pareto.forest import Forest
from pareto.front import nondominated
from pareto.hypervolume import hypervolume
from pareto.jury import TREES
from pareto.methods import METHODS, two_stage

SPACE = Space.from_dict(
    {
        "name": "toy",
        "parameters": [
            {"name": "size", "type": "ordinal", "values": [1, 2, 4, 8, 16, 32], "default": 8},
            {"name": "rate", "type": "integer", "minimum": 1, "maximum": 9, "default": 2},
            {"name": "kernel", "type": "categorical", "values": ["box", "cone", "ball"]},
            {"name": "fast", "type": "boolean"},
        ],
    }
)
OPTIONS = {
    "two-stage": {"initial": 8, "trees": 8, "candidates": 100, "points": 40},
    "algorithm1": {"initial": 12, "trees": 8},
    "random": {},
}
every_method = pytest.mark.parametrize("method", sorted(METHODS))


def measure(configuration):
    """Error and time of a made-up program; None where it crashes."""
    if configuration["kernel"] == "ball" and configuration["size"] >= 16:
        return None
    error = 0.3 / configuration["size"] + 0.01 * configuration["rate"] + 0.02 * configuration["fast"]
    seconds = configuration["size"] ** 1.5 / configuration["rate"] * (0.5 if configuration["fast"] else 1.0)
    return {"error": error * (1.2 if configuration["kernel"] == "cone" else 1.0), "seconds": seconds}


def explorer_of(method, objectives=("error", "seconds"), limits=None, seed=1, space=SPACE):
    return Explorer(space, objectives, limits, seed=seed, method=method, **OPTIONS[method])


def spend(explorer, budget, batch=5, measure=measure):
    asked = []
    while len(asked) < budget and (configurations := explorer.ask(min(batch, budget - len(asked)))):
        explorer.tell(configurations, [measure(item) for item in configurations])
        asked += configurations
    return asked


@every_method
def test_nothing_is_ever_asked_twice_and_everything_asked_lies_in_the_space(method):
    explorer = explorer_of(method)
    asked = spend(explorer, 100)
    indices = [SPACE.encode(configuration) for configuration in asked]
    assert len(set(indices)) == len(indices)
    if method != "algorithm1":
        assert len(asked) == 100


@every_method
def test_one_seed_asks_the_same_and_another_does_not(method):
    first, again, other = (explorer_of(method, seed=seed) for seed in (7, 7, 8))
    assert spend(first, 30) == spend(again, 30)
    spend(other, 30)
    assert first.ask(3) == again.ask(3)
    assert [*first.history.told] != [*other.history.told]


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
    waiting = []
    for _ in range(12):
        waiting += explorer.ask(4)
        waiting.reverse()
        now, waiting = waiting[:3], waiting[3:]
        explorer.tell(now, [measure(item) for item in now])
        assert len({SPACE.encode(item) for item in waiting}) == len(waiting)
        assert sorted(map(SPACE.encode, explorer.pending())) == sorted(map(SPACE.encode, waiting))
    told = len(explorer.history.told)
    explorer.tell(waiting, [measure(item) for item in waiting])
    assert len(explorer.history.told) == told + len(waiting)
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
    assert len(explorer.front()) == len(explorer.history.told)


@every_method
@pytest.mark.parametrize("objectives", [("error", "seconds"), ("error", "seconds", "watts")])
@pytest.mark.parametrize("fails", [0, 5])
def test_the_whole_space_can_be_exhausted(method, objectives, fails):
    space = Space.from_dict({"parameters": [{"name": "x", "type": "integer", "minimum": 1, "maximum": 15}]})
    explorer = explorer_of(method, objectives=objectives, space=space)

    def all_on_the_front(configuration):
        x = configuration["x"]
        return None if x <= fails else {"error": float(x), "seconds": 1.0 / x, "watts": 3.0 + x % 3}

    asked = spend(explorer, 99, measure=all_on_the_front)
    assert len(asked) == len({item["x"] for item in asked})
    if method != "algorithm1" or not fails:
        assert len(asked) == 15
    assert explorer.finished
    assert explorer.ask(5) == []


@every_method
@pytest.mark.parametrize("objectives", [("error",), ("error", "seconds", "size")])
def test_any_number_of_objectives(method, objectives):
    explorer = explorer_of(method, objectives=objectives)

    def with_size(configuration):
        values = measure(configuration)
        return values and {**values, "size": configuration["size"]}

    spend(explorer, 40, measure=with_size)
    told = [with_size(SPACE.decode(index)) for index in explorer.history.told]
    points = np.array([[values[name] for name in objectives] for values in told if values])
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
    assert all(SPACE.encode(item) not in range(0, 200, 7) for item in spend(explorer, 20))
    assert explorer.history.phases[7] == "imported"


@every_method
def test_proposals_name_their_phase(method):
    explorer = explorer_of(method)
    phases = []
    for _ in range(6):
        proposals = explorer.propose(6)
        phases += [proposal.phase for proposal in proposals]
        explorer.tell(
            [item.configuration for item in proposals], [measure(item.configuration) for item in proposals]
        )
    assert set(phases) <= {"random", "active"}
    assert phases[0] == "random"
    assert ("active" in phases) == (method != "random")


def test_repeats_ask_for_the_front_again_and_average():
    explorer = explorer_of("random")
    spend(explorer, 40)
    front = [configuration for configuration, _ in explorer.front()]
    again = explorer.ask(3, repeats=True)
    assert len(again) == 3
    assert all(configuration in front for configuration in again)
    before = dict(explorer.history.told)
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
def test_the_front_is_the_non_dominated_part_of_what_was_told_within_limits(told):
    explorer = Explorer(SPACE, ("a", "b"), {"a": 7}, method="random")
    last = {index: (a, b) for index, a, b in told}
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
    assert explorer.history.told == {}


def test_wrong_objectives_limits_methods_and_options_are_named():
    for arguments, error, message in [
        ({"objectives": "error"}, ObjectiveError, "list of names"),
        ({"objectives": ()}, ObjectiveError, "one or more"),
        ({"objectives": ("a", "a")}, ObjectiveError, "different"),
        ({"objectives": ("a",), "limits": {"b": 1}}, ObjectiveError, "'b'"),
        ({"objectives": ("a",), "limits": {"a": "low"}}, ObjectiveError, "'low'"),
        ({"objectives": ("a",), "method": "annealing"}, MethodError, "two-stage, algorithm1, random"),
        ({"objectives": ("a",), "method": "algorithm1", "forests": 3}, MethodError, "initial, trees"),
        ({"objectives": ("a",), "initial": 0}, MethodError, "1 or more"),
    ]:
        with pytest.raises(error, match=message):
            Explorer(SPACE, **arguments)


def test_a_state_of_another_space_version_or_shape_is_refused():
    state = explorer_of("random").state()
    other = Space.from_dict({"parameters": [{"name": "x", "type": "boolean"}]})
    with pytest.raises(StateError, match="another space"):
        Explorer.restore(other, state)
    with pytest.raises(StateError, match="version 99"):
        Explorer.restore(SPACE, {**state, "version": 99})
    with pytest.raises(StateError, match="observations"):
        Explorer.restore(SPACE, {key: value for key, value in state.items() if key != "observations"})


def test_algorithm_1_measures_its_predicted_front_and_stops():
    explorer = explorer_of("algorithm1")
    asked = spend(explorer, len(SPACE), batch=4)
    assert explorer.finished
    assert 12 < len(asked) < len(SPACE)
    assert set(explorer.history.phases.values()) == {"random", "active"}


def test_algorithm_1_refits_only_when_its_round_is_measured():
    explorer = explorer_of("algorithm1")
    first = explorer.ask(12)
    assert explorer.ask(5) == []
    assert not explorer.finished
    explorer.tell(first, [measure(item) for item in first])
    one_round = explorer.ask(1000)
    assert one_round
    explorer.tell(one_round[:-1], [measure(item) for item in one_round[:-1]])
    assert explorer.ask(1000) == []


def test_the_default_method_measures_the_default_configuration_first():
    assert Explorer(SPACE, ("error",)).ask(1) == [SPACE.default]


def test_the_default_method_finds_the_front_where_random_search_does_not():
    everything = [measure(SPACE.decode(index)) for index in range(len(SPACE))]
    points = np.array([[values["error"], values["seconds"]] for values in everything if values])
    true_front = {tuple(point) for point in points[nondominated(points)]}

    def found(method):
        explorer = explorer_of(method)
        spend(explorer, 80)
        return len(true_front & {(values["error"], values["seconds"]) for _, values in explorer.front()})

    assert found("two-stage") >= 0.8 * len(true_front) > found("random")


def test_the_default_method_searches_a_space_too_large_to_enumerate():
    parameters = [{"name": f"x{i}", "type": "integer", "minimum": 0, "maximum": 99} for i in range(5)]
    space = Space.from_dict({"parameters": parameters})
    explorer = explorer_of("two-stage", space=space, objectives=("far", "near"))

    def distances(configuration):
        x = np.array(list(configuration.values()))
        return {"far": float(np.sum((x - 20) ** 2)) + 1, "near": float(np.sum((x - 60) ** 2)) + 1}

    asked = spend(explorer, 60, batch=10, measure=distances)
    first, last = (
        np.mean([np.ptp(list(item.values())) for item in part]) for part in (asked[:8], asked[-20:])
    )
    assert last < first  # the front is the diagonal: all coordinates alike


def test_a_space_of_a_million_million_points_with_a_constraint_is_never_enumerated():
    parameters = [{"name": f"x{i}", "type": "integer", "minimum": 0, "maximum": 99} for i in range(6)]
    space = Space.from_dict({"parameters": parameters, "constraints": ["x0 + x1 <= 120"]})
    assert len(space) == 10**12
    explorer = explorer_of("two-stage", space=space, objectives=("far", "near"))
    asked = spend(
        explorer, 30, batch=10, measure=lambda item: {"far": 1 + item["x0"], "near": 200 - item["x1"]}
    )
    assert len({space.encode(item) for item in asked}) == 30
    assert all(item["x0"] + item["x1"] <= 120 for item in asked)
    with pytest.raises(MethodError, match="1,000,000,000,000 points"):
        explorer_of("algorithm1", space=space).ask(1)


@every_method
def test_the_number_of_random_configurations_is_an_option_of_every_method(method):
    explorer = Explorer(SPACE, ("error", "seconds"), method=method, **{**OPTIONS[method], "initial": 30})
    proposals = explorer.propose(30)
    assert [proposal.phase for proposal in proposals] == ["random"] * 30


def test_batches_of_one_share_a_screening_and_find_the_front_as_well():
    explorer = explorer_of("two-stage")
    asked = spend(explorer, 60, batch=1)
    assert len({SPACE.encode(item) for item in asked}) == 60
    memory = explorer.state()["memory"]
    assert 0 < memory["since"] <= 20
    assert memory["shortlist"]
    everything = [measure(SPACE.decode(index)) for index in range(len(SPACE))]
    points = np.array([[values["error"], values["seconds"]] for values in everything if values])
    true_front = {tuple(point) for point in points[nondominated(points)]}
    found = {(values["error"], values["seconds"]) for _, values in explorer.front()}
    assert len(true_front & found) >= 0.6 * len(true_front)


@pytest.mark.parametrize("batch", [1, 2])
def test_every_opinion_has_its_turn_in_small_batches_that_remember_nothing(batch, monkeypatch):
    turns = []
    greedy = two_stage._greedy

    def noted(surrogates, found, waiting, count, turn, rng):
        turns.extend((turn + number) % 3 for number in range(count))
        return greedy(surrogates, found, waiting, count, turn, rng)

    monkeypatch.setattr(two_stage, "_greedy", noted)
    explorer = explorer_of("two-stage")
    spend(explorer, 8)
    for _ in range(9 // batch):
        explorer = Explorer.restore(SPACE, explorer.state() | {"memory": {}})
        spend(explorer, batch, batch)
    assert len(turns) >= 6
    assert min(map(turns.count, range(3))) >= len(turns) // 4


def test_small_batches_share_the_trees_and_restore_with_them(monkeypatch):
    grown = []
    grow = Forest.grow.__func__

    def noted(kind, codes, targets, shape, *, seed, trees, **more):
        grown.append(trees)
        return grow(kind, codes, targets, shape, seed=seed, trees=trees, **more)

    monkeypatch.setattr(Forest, "grow", classmethod(noted))
    explorer = explorer_of("two-stage")
    spend(explorer, 20, measure=lambda item: measure(item) if item["fast"] else None)
    grown.clear()
    spend(explorer, 20, batch=1)
    assert 0 < grown.count(TREES) <= 2
    restored = Explorer.restore(SPACE, json.loads(json.dumps(explorer.state())))
    assert spend(restored, 4, batch=1) == spend(explorer, 4, batch=1)
    assert restored.state() == explorer.state()


def test_a_batch_spreads_along_the_front_instead_of_crowding_at_its_best_point():
    explorer = explorer_of("two-stage")
    spend(explorer, 30)
    batch = [item for item in explorer.propose(12) if item.phase == "active"]
    errors = [measured["error"] for item in batch if (measured := measure(item.configuration))]
    known = [values["error"] for _, values in explorer.front()]
    assert len(errors) >= 6
    assert np.ptp(errors) > 0.3 * np.ptp(known)


def test_where_one_region_always_fails_it_is_left_alone():
    explorer = explorer_of("two-stage")
    spend(explorer, 60, measure=lambda item: measure(item) if item["fast"] else None)
    active = [index for index, phase in explorer.history.phases.items() if phase == "active"]
    failed = set(explorer.history.failed().tolist())
    assert len(active) > 30
    assert np.mean([index in failed for index in active]) < 0.3  # more than half of the space fails


@pytest.mark.parametrize("objectives", [1, 4])
def test_one_objective_and_four_get_better_than_by_chance(objectives):
    space = Space.from_dict(
        {"parameters": [{"name": f"x{i}", "type": "integer", "minimum": 0, "maximum": 7} for i in range(4)]}
    )
    names = [f"y{k}" for k in range(objectives)]

    def distances(configuration):
        x = np.array(list(configuration.values()))
        return {name: 1.0 + float(np.sum((x - 2 - k) ** 2)) for k, name in enumerate(names)}

    def covered(method):
        explorer = explorer_of(method, space=space, objectives=names)
        spend(explorer, 50, measure=distances)
        front = [[values[name] for name in names] for _, values in explorer.front()]
        return hypervolume(front, [60.0] * objectives, log=True)

    assert covered("two-stage") > covered("random")


@pytest.mark.parametrize("batch", [1, 3, 8])
def test_the_first_configurations_are_one_design_in_whatever_portions_it_is_asked_for(batch):
    at_once = Explorer(SPACE, ("error", "seconds"), seed=4, initial=24).ask(24)
    explorer = Explorer(SPACE, ("error", "seconds"), seed=4, initial=24)
    assert spend(explorer, 24, batch=batch) == at_once
    assert [item["kernel"] for item in at_once].count("box") in range(6, 11)


def test_limits_that_nothing_keeps_yet_are_headed_for():
    space = Space.from_dict(
        {"parameters": [{"name": f"x{i}", "type": "integer", "minimum": 0, "maximum": 29} for i in range(3)]}
    )

    def measured(configuration):
        x = np.array(list(configuration.values()))
        return {"error": 1.0 + float(np.sum((x - [25, 4, 20]) ** 2)), "seconds": 1.0 + configuration["x0"]}

    limits = {"error": 13.0}  # kept by one point in a hundred and fifty
    explorer = Explorer(space, ("error", "seconds"), limits, seed=2, trees=8, candidates=300)
    first = spend(explorer, 40, measure=measured)
    assert all(measured(item)["error"] > 13 for item in first)
    spend(explorer, 60, batch=10, measure=measured)
    errors = {values["error"] for _, values in explorer.front()}
    assert len(errors & {1.0, 2.0, 5.0, 10.0}) >= 3  # the true front


@pytest.mark.parametrize("scale", [-1e-12, -1e300])
def test_the_unit_of_an_objective_does_not_matter(scale):
    def scaled(configuration):
        values = measure(configuration)
        return values and {"error": values["error"], "rate": values["seconds"] * scale}

    explorer = explorer_of("two-stage", objectives=("error", "rate"))
    spend(explorer, 40, measure=scaled)
    phases = list(explorer.history.phases.values())
    assert phases[8:].count("active") > 20


def test_a_batch_may_be_as_large_as_the_space():
    explorer = explorer_of("two-stage")
    spend(explorer, 20)
    assert len(explorer.ask(10**6)) == len(SPACE) - 20


def test_a_search_ends_only_after_a_long_look_for_rare_points(monkeypatch):
    monkeypatch.setattr("pareto.region.LARGEST_JOIN", 1)
    monkeypatch.setattr("pareto.methods.two_stage.DRAWS", 1)
    parameters = [{"name": f"p{i}", "type": "integer", "minimum": 0, "maximum": 99} for i in range(3)]
    rare = {"parameters": parameters, "constraints": ["p0 * p1 * p2 >= 940000"]}
    explorer = Explorer(Space.from_dict(rare), ("time",), initial=1)
    for _ in range(6):
        batch = explorer.ask(1)
        explorer.tell(batch, [None] * len(batch))
    assert len(explorer.history.told) == 6
    assert not explorer.finished
