"""Knowledge from another device: it guides, never counts as measured, and is checked like all input."""

import json

import numpy as np
import pytest

from pareto import Explorer, Objective
from pareto.errors import ConfigurationError, MethodError, ObjectiveError
from pareto.search.methods import METHODS
from pareto.search.prior import Prior
from pareto.search.targets import Targets
from pareto.surrogates.forest import Forest
from tests.builders.spaces import space_of
from tests.pareto.search.made_up_devices import SOURCE, SPACE, TARGET, pairs, some_of_the_source
from tests.pareto.searches import advance


def on_target(proposal):
    return {"seconds": float(TARGET[proposal.index])}


def test_a_prior_is_neither_a_measurement_nor_on_the_front():
    explorer = Explorer(SPACE, ("seconds",), prior=some_of_the_source())
    assert explorer.front() == []
    assert explorer.history.results == {}
    assert len(explorer.history.measured()[0]) == 0
    assert explorer.history.taken() == set()
    first = explorer.ask(1)
    explorer.tell(first, [{"seconds": 9.9}])
    assert explorer.front() == [(first[0], {"seconds": 9.9})]


def test_what_the_source_measured_may_be_asked_for_here():
    everything = pairs(SOURCE, range(len(SPACE)))
    explorer = Explorer(SPACE, ("seconds",), prior=everything)
    assert len(explorer.ask(40)) == 40


def test_the_first_proposals_hold_the_sources_best():
    explorer = Explorer(SPACE, ("seconds",), prior=pairs(SOURCE, range(len(SPACE))))
    proposals = explorer.propose(21)
    tried = [proposal.index for proposal in proposals if proposal.phase == "active"]
    assert int(np.argmin(SOURCE)) in tried
    assert len(tried) == 10
    assert set(tried) <= set(np.argsort(SOURCE)[:40].tolist())
    assert proposals[0].configuration == SPACE.default


@pytest.mark.slow
@pytest.mark.parametrize("portion", [1, 2, 3, 20])
def test_the_sources_best_come_in_portions_of_any_size(portion):
    explorer = Explorer(SPACE, ("seconds",), prior=some_of_the_source())
    phases = []
    while len(phases) < 20:
        phases += [item.phase for item in advance(explorer, min(portion, 20 - len(phases)), on_target)]
    assert phases[0] == "random"  # the default configuration
    assert phases.count("active") == (20 - phases.count("again")) // 2


@pytest.mark.slow
def test_fewer_come_first_only_where_the_source_measured_what_would():
    design = {item.index for item in Explorer(SPACE, ("seconds",), seed=2, initial=40).propose(40)}

    def after_twenty(known):
        explorer = Explorer(SPACE, ("seconds",), seed=2, prior=pairs(SOURCE, known), initial=40)
        advance(explorer, 20, on_target)
        return explorer.propose(10)

    others = [index for index in range(0, len(SPACE), 4) if index not in design]
    # One of the first twenty was a repeat, so one that did well on the other device is still to come.
    assert len({item.index for item in after_twenty(others)} - design) <= 1
    assert [item.phase for item in after_twenty([*design, *others])].count("active") >= 7


def test_a_restored_explorer_keeps_its_prior_and_proposes_the_same():
    prior = [*some_of_the_source(), (SPACE.decode(77), None)]
    explorer = Explorer(SPACE, ("seconds",), seed=4, prior=prior, initial=10)
    for _ in range(3):
        advance(explorer, 5, on_target)
    state = json.loads(json.dumps(explorer.state()))
    restored = Explorer.restore(SPACE, state)
    assert restored.state() == explorer.state()
    assert restored.ask(5) == explorer.ask(5)
    without = Explorer.restore(SPACE, {key: value for key, value in state.items() if key != "prior"})
    assert without._method.prior is None


@pytest.mark.parametrize("method", sorted(METHODS))
def test_methods_use_a_prior_or_refuse_it(method):
    if METHODS[method].uses_prior:
        assert Explorer(SPACE, ("seconds",), method=method, prior=some_of_the_source()).ask(2)
    else:
        with pytest.raises(MethodError, match=f"'{method}' cannot use a prior: bayesian can"):
            Explorer(SPACE, ("seconds",), method=method, prior=some_of_the_source())
    assert Explorer(SPACE, ("seconds",), method=method, prior=[])._method.prior is None


def test_a_prior_is_checked_like_measurements():
    with pytest.raises(ObjectiveError, match="'seconds' is missing"):
        Explorer(SPACE, ("seconds",), prior=[(SPACE.default, {"watts": 1.0})])
    with pytest.raises(ConfigurationError, match="'blok'"):
        Explorer(SPACE, ("seconds",), prior=[({"blok": 1}, {"seconds": 1.0})])


def test_a_prior_of_failures_only_changes_nothing():
    failures = [(SPACE.decode(index), None) for index in range(20)]
    assert Explorer(SPACE, ("seconds",), prior=failures).ask(30) == Explorer(SPACE, ("seconds",)).ask(30)


def test_points_are_ranked_front_after_front_spread_out_and_within_limits_first():
    objectives = (Objective("error"), Objective("seconds"))
    x = np.arange(9)
    rows = [(x_, float(x_ + 1), 9.0 - x_) for x_ in x] + [(20, 5.5, 5.5), (21, 30.0, 0.1)]
    measurements = [(SPACE.decode(int(i)), {"error": a, "seconds": b}) for i, a, b in rows]
    prior = Prior.read(SPACE, objectives, {"error": 20.0}, measurements)
    order = prior.ranked(11).tolist()
    assert order[:3] == [0, 8, 4]
    assert sorted(order[:9]) == list(range(9))
    assert order[9:] == [20, 21]
    assert len(prior.ranked(4)) == 4


@pytest.mark.slow
def test_promising_points_are_the_best_and_unlike_each_other():
    prior = Prior.read(SPACE, (Objective("seconds"),), {}, pairs(SOURCE, range(len(SPACE))))
    best = np.argsort(SOURCE)
    chosen = prior.promising(10)
    assert chosen[0] == best[0]
    assert set(chosen[:3]) <= set(best[:9])
    assert set(chosen) <= set(best[:37])

    def unlikeness(indices):
        features = SPACE.features(indices)
        return np.abs(features[:, None] - features).sum(axis=2).mean()

    assert unlikeness(chosen) > 1.1 * unlikeness(best[:10])
    one_by_one: list[int] = []
    for _ in range(10):
        one_by_one += prior.promising(1, exclude=one_by_one).tolist()
    assert one_by_one == chosen.tolist()
    assert len(prior.promising(0)) == len(prior.promising(-3)) == 0
    few = Prior.read(SPACE, (Objective("seconds"),), {}, pairs(SOURCE, [4, 9, 2]))
    assert sorted(few.promising(7)) == [2, 4, 9]
    assert sorted(few.promising(7, exclude=[9, 55])) == [2, 4]


def test_a_space_too_large_to_enumerate_is_predicted_where_asked(monkeypatch):
    space = space_of(**{f"x{i}": range(100) for i in range(5)})
    known = np.random.default_rng(1).choice(len(space), 60, replace=False)
    measurements = [(space.decode(int(i)), {"far": float(i % 100 + 1)}) for i in known]
    prior = Prior.read(space, (Objective("far"),), {}, measurements)
    measured = Targets.of(prior.source).values
    assert prior.expected(known) == pytest.approx(measured)
    monkeypatch.setattr(Forest, "grow", None)  # what was grown once is kept
    assert prior.expected(known[:5]) == pytest.approx(measured[:5])
    monkeypatch.undo()
    explorer = Explorer(space, ("far",), prior=measurements, initial=10)
    for _ in range(3):
        asked = explorer.ask(8)
        explorer.tell(asked, [{"far": float(item["x4"] + 1)} for item in asked])
    assert len(explorer.history.results) == 22  # two were measured twice
