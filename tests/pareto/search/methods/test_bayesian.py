"""What the default method is for, in batches of any size and in spaces of any."""

import json

import numpy as np
import pytest

from pareto import Explorer
from pareto.errors import MethodError
from pareto.fronts.front import nondominated
from pareto.fronts.hypervolume import hypervolume
from pareto.search.methods import bayesian
from pareto.surrogates.forest import Forest
from pareto.surrogates.success import TREES
from tests.builders.spaces import space_of
from tests.pareto.searches import SPACE, explorer_of, measure, repeats_in, spend


def test_the_default_method_measures_the_default_configuration_first():
    assert Explorer(SPACE, ("error",)).ask(1) == [SPACE.default]


def share_found(explorer):
    """The share of the made-up program's true front that `explorer` has measured."""
    everything = [measure(SPACE.decode(index)) for index in range(len(SPACE))]
    points = np.array([[values["error"], values["seconds"]] for values in everything if values])
    true_front = {tuple(point) for point in points[nondominated(points)]}
    front = {(values["error"], values["seconds"]) for _, values in explorer.front()}
    return len(true_front & front) / len(true_front)


@pytest.mark.slow
def test_the_default_method_finds_the_front_where_random_search_does_not():
    ours, random = explorer_of("bayesian"), explorer_of("random")
    for explorer in (ours, random):
        spend(explorer, 80)
    assert share_found(ours) >= 0.8 > share_found(random)


def test_the_default_method_searches_a_space_too_large_to_enumerate():
    space = space_of(**{f"x{i}": range(100) for i in range(5)})
    explorer = explorer_of("bayesian", space=space, objectives=("far", "near"))

    def distances(configuration):
        x = np.array(list(configuration.values()))
        return {"far": float(np.sum((x - 20) ** 2)) + 1, "near": float(np.sum((x - 60) ** 2)) + 1}

    asked = spend(explorer, 60, batch=10, measure=distances)
    first, last = (
        np.mean([np.ptp(list(item.values())) for item in part]) for part in (asked[:8], asked[-20:])
    )
    assert last < first  # the front is the diagonal: all coordinates alike


def test_a_space_of_a_million_million_points_with_a_constraint_is_never_enumerated():
    space = space_of("x0 + x1 <= 120", **{f"x{i}": range(100) for i in range(6)})
    assert len(space) == 10**12
    explorer = explorer_of("bayesian", space=space, objectives=("far", "near"))
    distances = lambda item: {"far": 1 + item["x0"], "near": 200 - item["x1"]}  # noqa: E731
    asked = spend(explorer, 30, batch=10, measure=distances)
    assert len(asked) == 30
    assert repeats_in(asked, space) <= 2
    assert all(item["x0"] + item["x1"] <= 120 for item in asked)
    with pytest.raises(MethodError, match="1,000,000,000,000 points"):
        explorer_of("algorithm1", space=space).ask(1)


@pytest.mark.slow
def test_batches_of_one_share_a_pool_and_find_the_front_as_well():
    explorer = explorer_of("bayesian")
    asked = spend(explorer, 50, batch=1)
    assert len(asked) == 50
    assert repeats_in(asked) <= 2
    memory = explorer.state()["memory"]
    assert 0 < memory["since"] <= 20
    assert memory["shortlist"]
    assert share_found(explorer) >= 0.6


@pytest.mark.parametrize("far", [0.0, 0.4, 0.7, 1.0])
def test_the_overall_gain_has_its_share_of_any_twenty_turns(far):
    turns = [bayesian.looks_elsewhere(turn, far) for turn in range(1000)]
    for begin in range(0, 1000, 20):
        assert abs(sum(turns[begin : begin + 20]) - 20 * far) <= 2


def test_a_gain_that_sees_nothing_takes_no_place_on_the_shortlist():
    gain = np.zeros((2, 8))
    gain[0, [2, 5, 7]] = 3.0, 1.0, 2.0
    gain[1, [5, 6]] = 5.0, 4.0
    assert bayesian._best_of_each(gain, 4).tolist() == [2, 5, 7, 6]
    assert sorted(bayesian._best_of_each(gain, 9).tolist()) == list(range(8))


@pytest.mark.slow
def test_small_batches_share_the_trees_and_restore_with_them(monkeypatch):
    grown = []
    grow = Forest.grow.__func__

    def noted(kind, codes, targets, shape, *, seed, trees, **more):
        grown.append(trees)
        return grow(kind, codes, targets, shape, seed=seed, trees=trees, **more)

    monkeypatch.setattr(Forest, "grow", classmethod(noted))
    explorer = explorer_of("bayesian")
    spend(explorer, 20, measure=lambda item: measure(item) if item["fast"] else None)
    grown.clear()
    spend(explorer, 20, batch=1)
    assert 0 < grown.count(TREES) <= 4  # of two models of success
    restored = Explorer.restore(SPACE, json.loads(json.dumps(explorer.state())))
    assert spend(restored, 4, batch=1) == spend(explorer, 4, batch=1)
    assert restored.state() == explorer.state()


def test_with_much_measured_single_proposals_are_chosen_a_few_at_a_time(monkeypatch):
    monkeypatch.setattr(bayesian, "AHEAD", 5)
    sizes = []
    greedy = bayesian._greedy

    def noted(models, pool, waiting, count, turn, rng):
        sizes.append(count)
        return greedy(models, pool, waiting, count, turn, rng)

    monkeypatch.setattr(bayesian, "_greedy", noted)
    explorer = explorer_of("bayesian")
    spend(explorer, 40)
    sizes.clear()
    spend(explorer, 4, batch=1)
    assert sizes == [38 // 5]
    assert explorer.state()["memory"]["ahead"]
    restored = Explorer.restore(SPACE, json.loads(json.dumps(explorer.state())))
    assert spend(restored, 12, batch=1) == spend(explorer, 12, batch=1)
    assert restored.state() == explorer.state()


def test_what_was_chosen_ahead_is_dropped_once_others_measured_as_much(monkeypatch):
    monkeypatch.setattr(bayesian, "AHEAD", 2)
    explorer = explorer_of("bayesian")
    explorer.budget = 1  # without first repeats
    spend(explorer, 20)
    spend(explorer, 1, batch=1)
    memory = explorer.state()["memory"]
    assert memory["ahead"]
    free = [
        index
        for index in range(len(SPACE))
        if index not in {*explorer.history.results, *dict(memory["ahead"])}
    ]
    others = [SPACE.decode(index) for index in free[: memory["until"] - len(explorer.history.results)]]
    explorer.tell(others, [measure(item) for item in others])
    taken = len(explorer.history.results)
    spend(explorer, 1, batch=1)
    assert explorer.state()["memory"]["until"] == taken + taken // 2


def test_a_batch_spreads_along_the_front_instead_of_crowding_at_its_best_point():
    explorer = explorer_of("bayesian")
    spend(explorer, 30)
    batch = [item for item in explorer.propose(12) if item.phase == "active"]
    errors = [measured["error"] for item in batch if (measured := measure(item.configuration))]
    front_errors = [values["error"] for _, values in explorer.front()]
    assert len(errors) >= 6
    assert np.ptp(errors) > 0.3 * np.ptp(front_errors)


@pytest.mark.slow
def test_where_one_region_always_fails_it_is_left_alone():
    explorer = explorer_of("bayesian")
    spend(explorer, 45, measure=lambda item: measure(item) if item["fast"] else None)
    active = [index for index, phase in explorer.history.phases.items() if phase == "active"]
    failed = set(explorer.history.failed().tolist())
    assert len(active) > 20
    assert np.mean([index in failed for index in active]) < 0.3  # more than half of the space fails


@pytest.mark.slow
@pytest.mark.parametrize("objectives", [1, 4])
def test_one_objective_and_four_get_better_than_by_chance(objectives):
    space = space_of(**{f"x{i}": range(8) for i in range(4)})
    names = [f"y{k}" for k in range(objectives)]

    def distances(configuration):
        x = np.array(list(configuration.values()))
        return {name: 1.0 + float(np.sum((x - 2 - k) ** 2)) for k, name in enumerate(names)}

    def covered(method):
        explorer = explorer_of(method, space=space, objectives=names)
        spend(explorer, 50, batch=10, measure=distances)
        front = [[values[name] for name in names] for _, values in explorer.front()]
        return hypervolume(front, [60.0] * objectives, log=True)

    assert covered("bayesian") > covered("random")


@pytest.mark.parametrize("batch", [1, 3, 8])
def test_the_first_configurations_are_one_design_in_whatever_portions_it_is_asked_for(batch):
    at_once = Explorer(SPACE, ("error", "seconds"), seed=4, initial=24, budget=1).ask(24)
    explorer = Explorer(SPACE, ("error", "seconds"), seed=4, initial=24, budget=1)
    assert spend(explorer, 24, batch=batch) == at_once
    assert [item["kernel"] for item in at_once].count("box") in range(6, 11)


@pytest.mark.parametrize(
    ("options", "succeeds", "first"),
    [({}, 1.0, 20), ({}, 0.6, 35), ({}, 0.0, 40), ({"initial": 26}, 1.0, 26), ({"initial": 50}, 0.0, 50)],
)
def test_the_design_goes_on_until_there_is_enough_to_learn_from_unless_its_size_is_given(
    options, succeeds, first
):
    explorer = Explorer(SPACE, ("error", "seconds"), seed=4, budget=1, **options)
    whole = {"initial": options.get("initial", 40), "budget": 1}
    design = Explorer(SPACE, ("error", "seconds"), seed=4, **whole).ask(50)
    count = 0

    def measured(configuration):
        nonlocal count
        count += 1
        fails = int(count * (1.0 - succeeds)) > int((count - 1) * (1.0 - succeeds))
        return None if fails else {"error": 1.0 + count % 7, "seconds": 1.0 + count % 5}

    asked = spend(explorer, first + 10, measure=measured)
    assert asked[:first] == design[:first]
    assert asked[first : first + 5] != design[first : first + 5]


def test_limits_that_nothing_keeps_yet_are_headed_for():
    space = space_of(**{f"x{i}": range(30) for i in range(3)})

    def measured(configuration):
        x = np.array(list(configuration.values()))
        return {"error": 1.0 + float(np.sum((x - [25, 4, 20]) ** 2)), "seconds": 1.0 + configuration["x0"]}

    limits = {"error": 13.0}  # kept by one point in a hundred and fifty
    explorer = Explorer(space, ("error", "seconds"), limits, seed=2, candidates=300, initial=40)
    first = spend(explorer, 40, measure=measured)
    assert all(measured(item)["error"] > 13 for item in first)
    spend(explorer, 60, batch=10, measure=measured)
    errors = {values["error"] for _, values in explorer.front()}
    assert len(errors & {1.0, 2.0, 5.0, 10.0}) >= 3  # the true front


@pytest.mark.slow
@pytest.mark.parametrize("scale", [-1e-12, -1e300])
def test_the_unit_of_an_objective_does_not_matter(scale):
    def scaled(configuration):
        values = measure(configuration)
        return values and {"error": values["error"], "rate": values["seconds"] * scale}

    explorer = explorer_of("bayesian", objectives=("error", "rate"))
    spend(explorer, 25, measure=scaled)
    phases = list(explorer.history.phases.values())
    assert phases[8:].count("active") > 10


def test_a_batch_may_be_as_large_as_the_space():
    explorer = explorer_of("bayesian")
    spend(explorer, 20)
    asked = explorer.ask(10**6)
    measured = {*explorer.history.results}
    assert measured | {SPACE.encode(item) for item in asked} == set(range(len(SPACE)))
    assert len(asked) - (len(SPACE) - len(measured)) <= 1  # one again


def test_a_search_ends_only_after_a_long_look_for_rare_points(monkeypatch):
    monkeypatch.setattr("pareto.spaces.region.LARGEST_JOIN", 1)
    monkeypatch.setattr("pareto.search.methods.bayesian.DRAWS", 1)
    rare = space_of("p0 * p1 * p2 >= 940000", **{f"p{i}": range(100) for i in range(3)})
    explorer = Explorer(rare, ("time",), initial=1)
    for _ in range(6):
        batch = explorer.ask(1)
        explorer.tell(batch, [None] * len(batch))
    assert len(explorer.history.results) == 6
    assert not explorer.finished
