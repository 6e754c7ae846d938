"""Knowledge from another device: it guides, never counts as measured, and is distrusted when wrong."""

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

from pareto import Explorer, Objective, Space
from pareto.errors import ConfigurationError, MethodError, ObjectiveError
from pareto.fronts.front import nondominated
from pareto.search.history import History
from pareto.search.methods import METHODS
from pareto.search.targets import Targets
from pareto.search.transfer import Prior, Trend, trusted
from pareto.surrogates.forest import Forest

SPACE = Space.from_dict(
    {
        "name": "kernels",
        "parameters": [
            {"name": "block", "type": "ordinal", "values": [1, 2, 4, 8, 16, 32, 64, 128]},
            {"name": "tile", "type": "integer", "minimum": 1, "maximum": 8},
            {"name": "unroll", "type": "integer", "minimum": 1, "maximum": 8},
            {"name": "layout", "type": "categorical", "values": ["rows", "columns", "morton"]},
        ],
    }
)
CODES = SPACE.codes(np.arange(len(SPACE)))


def times(optimum, roughness, seed=0):
    """Seconds of every configuration on a made-up device: a bowl around `optimum`, and roughness."""
    rng = np.random.default_rng(seed)
    bowl = (np.array([0.08, 0.05, 0.03, 0.5]) * (CODES - optimum) ** 2).sum(axis=1)
    return 0.01 * np.exp(bowl + roughness * rng.standard_normal(len(SPACE)))


SOURCE = times([6, 2, 5, 1], 0.2, seed=1)
TARGET = 7.0 * times([5, 3, 5, 1], 0.2, seed=2) ** 0.8


def pairs(values, indices, name="seconds"):
    return [(SPACE.decode(int(index)), {name: float(values[index])}) for index in indices]


def evaluations_needed(seed, prior=(), target=TARGET, budget=120, within=1.15):
    """How many measurements until one is `within` of the target's best; one more than the budget if none."""
    explorer = Explorer(SPACE, ("seconds",), seed=seed, prior=prior, initial=12)
    good = target.min() * within
    for done in range(0, budget, 6):
        proposals = explorer.propose(6)
        measured = [target[proposal.index] for proposal in proposals]
        explorer.tell(
            [proposal.configuration for proposal in proposals], [{"seconds": float(t)} for t in measured]
        )
        if min(measured) <= good:
            return done + 1 + int(np.argmax(np.array(measured) <= good))
    return budget + 1


def some_of_the_source(values=SOURCE, count=150):
    return pairs(values, np.random.default_rng(3).choice(len(SPACE), count, replace=False))


def test_a_prior_is_neither_told_nor_on_the_front():
    explorer = Explorer(SPACE, ("seconds",), prior=some_of_the_source())
    assert explorer.front() == []
    assert explorer.history.told == {}
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


@pytest.mark.parametrize("portion", [1, 2, 3, 20])
def test_the_sources_best_come_in_portions_of_any_size(portion):
    explorer = Explorer(SPACE, ("seconds",), prior=pairs(SOURCE, range(len(SPACE))))
    phases = []
    while len(phases) < 20:
        proposals = explorer.propose(min(portion, 20 - len(phases)))
        values = [{"seconds": float(TARGET[item.index])} for item in proposals]
        explorer.tell([item.configuration for item in proposals], values)
        phases += [item.phase for item in proposals]
    assert phases[0] == "random"  # the default configuration
    assert phases.count("active") == 10


def test_fewer_come_first_only_where_the_source_measured_what_would():
    design = {item.index for item in Explorer(SPACE, ("seconds",), seed=2, initial=40).propose(40)}

    def after_twenty(known):
        explorer = Explorer(SPACE, ("seconds",), seed=2, prior=pairs(SOURCE, known), initial=40)
        first = explorer.propose(20)
        values = [{"seconds": float(TARGET[item.index])} for item in first]
        explorer.tell([item.configuration for item in first], values)
        return explorer.propose(10)

    others = [index for index in range(len(SPACE)) if index not in design]
    assert {item.index for item in after_twenty(others)} <= design
    assert [item.phase for item in after_twenty(range(len(SPACE)))].count("active") >= 7


def test_a_restored_explorer_keeps_its_prior_and_proposes_the_same():
    prior = [*some_of_the_source(), (SPACE.decode(77), None)]
    explorer = Explorer(SPACE, ("seconds",), seed=4, prior=prior, initial=10)
    for _ in range(3):
        proposals = explorer.propose(5)
        explorer.tell(
            [item.configuration for item in proposals],
            [{"seconds": float(TARGET[item.index])} for item in proposals],
        )
    state = json.loads(json.dumps(explorer.state()))
    restored = Explorer.restore(SPACE, state)
    assert restored.state() == explorer.state()
    assert restored.ask(5) == explorer.ask(5)
    without = Explorer.restore(SPACE, {key: value for key, value in state.items() if key != "prior"})
    assert without.history.prior is None


@pytest.mark.parametrize("method", sorted(METHODS))
def test_methods_heed_a_prior_or_refuse_it(method):
    if METHODS[method].uses_prior:
        assert Explorer(SPACE, ("seconds",), method=method, prior=some_of_the_source()).ask(2)
    else:
        with pytest.raises(MethodError, match=f"'{method}' heeds no prior: .*two-stage"):
            Explorer(SPACE, ("seconds",), method=method, prior=some_of_the_source())
    assert Explorer(SPACE, ("seconds",), method=method, prior=[]).history.prior is None


def test_a_prior_is_checked_like_what_is_told():
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
    told = [(SPACE.decode(int(i)), {"error": a, "seconds": b}) for i, a, b in rows]
    prior = Prior.read(SPACE, objectives, {"error": 20.0}, told)
    order = prior.ranked(11).tolist()
    assert order[:3] == [0, 8, 4]
    assert sorted(order[:9]) == list(range(9))
    assert order[9:] == [20, 21]
    assert len(prior.ranked(4)) == 4


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


def history_of(values, indices, prior):
    history = History(SPACE, (Objective("seconds"),), {})
    history.prior = prior
    for index in indices:
        history.record(int(index), (float(values[index]),))
    return history


@pytest.mark.parametrize(
    ("source", "sign"), [(SOURCE, 1), (1 / SOURCE, -1), (np.random.default_rng(6).permutation(SOURCE), 0)]
)
def test_the_trend_follows_the_source_as_far_as_it_is_borne_out(source, sign):
    prior = Prior.read(SPACE, (Objective("seconds"),), {}, pairs(source, range(len(SPACE))))
    history = history_of(TARGET, np.random.default_rng(7).choice(len(SPACE), 40, replace=False), prior)
    targets = Targets.of(history)
    trend = Trend.of(history, targets)
    assert np.sign(trend.slope[0]) == sign
    assert trusted(history) == (sign > 0)
    everywhere = trend(np.arange(len(SPACE)))[:, 0]
    if sign:
        assert np.corrcoef(everywhere, np.log(TARGET))[0, 1] > 0.5
    else:
        assert not everywhere.any()


def test_a_space_too_large_to_enumerate_is_predicted_where_asked(monkeypatch):
    parameters = [{"name": f"x{i}", "type": "integer", "minimum": 0, "maximum": 99} for i in range(5)]
    space = Space.from_dict({"parameters": parameters})
    known = np.random.default_rng(1).choice(len(space), 60, replace=False)
    told = [(space.decode(int(i)), {"far": float(i % 100 + 1)}) for i in known]
    prior = Prior.read(space, (Objective("far"),), {}, told)
    measured = Targets.of(prior.source).values
    assert prior.expected(known) == pytest.approx(measured)
    monkeypatch.setattr(Forest, "grow", None)  # what was grown once is kept
    assert prior.expected(known[:5]) == pytest.approx(measured[:5])
    monkeypatch.undo()
    explorer = Explorer(space, ("far",), prior=told, initial=10)
    for _ in range(3):
        asked = explorer.ask(8)
        explorer.tell(asked, [{"far": float(item["x4"] + 1)} for item in asked])
    assert len(explorer.history.told) == 24


@pytest.fixture(scope="module")
def alone():
    """Measurements needed without a prior, by seed."""
    return [evaluations_needed(seed) for seed in range(5)]


def test_a_related_device_saves_measurements(alone):
    helped = [evaluations_needed(seed, some_of_the_source()) for seed in range(5)]
    # Both begin with 12; what is saved is of those that come after.
    assert np.mean(helped) - 12 < 0.5 * (np.mean(alone) - 12), (helped, alone)


@pytest.mark.parametrize("wrong", [1 / SOURCE, np.random.default_rng(6).permutation(SOURCE)])
def test_a_device_that_is_the_opposite_or_says_nothing_costs_little(alone, wrong):
    misled = [evaluations_needed(seed, some_of_the_source(wrong)) for seed in range(5)]
    # What it may cost is its share of the first configurations, half of 12, and a batch until it is refuted.
    assert np.mean(misled) <= np.mean(alone) + 12, (misled, alone)


def test_objectives_are_trusted_one_by_one():
    """An error that no device changes, and a time that says nothing: the front is found all the same."""
    error = 1.0 / (1 + CODES[:, 0]) + 0.02 * CODES[:, 2]
    noise = np.random.default_rng(9).permutation(SOURCE)
    told = [
        (SPACE.decode(int(i)), {"error": float(error[i]), "seconds": float(noise[i])})
        for i in np.random.default_rng(3).choice(len(SPACE), 200, replace=False)
    ]
    explorer = Explorer(SPACE, ("error", "seconds"), prior=told, initial=24)
    for _ in range(8):
        proposals = explorer.propose(10)
        explorer.tell(
            [item.configuration for item in proposals],
            [{"error": float(error[item.index]), "seconds": float(TARGET[item.index])} for item in proposals],
        )
    slope = Trend.of(explorer.history, Targets.of(explorer.history)).slope
    assert slope[0] > 0.5
    assert abs(slope[1]) < 0.3
    truth = np.stack([error, TARGET], axis=1)
    values = np.array([list(values.values()) for _, values in explorer.front()])
    true_front = truth[nondominated(truth)]
    near = [(np.log(values / point).max(axis=1)).min() for point in true_front]
    assert np.median(near) < 0.1


def convolution():
    """The convolution kernel's space and its times on two real GPUs, (points,) with NaN where one failed."""
    if "FRONTRUNNER_DATA" not in os.environ:
        pytest.skip("FRONTRUNNER_DATA is not set: it names the folder with dse/convolution")
    folder = Path(os.environ["FRONTRUNNER_DATA"]) / "dse" / "convolution"
    tables = []
    for device in ("A100", "A4000"):
        with (folder / f"convolution_{device}.csv").open(newline="") as file:
            tables.append(list(csv.DictReader(file)))
    names = ["block_size_x", "block_size_y", "tile_size_x", "tile_size_y", "read_only"]
    names += ["use_padding", "use_shmem"]
    parameters = [
        {"name": name, "type": "ordinal", "values": sorted({int(row[name]) for row in tables[0]})}
        for name in names
    ]
    constraints = [
        "block_size_x * block_size_y <= 1024",
        "use_padding == 0 or (block_size_x % 32 != 0 and use_shmem == 1)",
        "use_shmem == 0 or (block_size_x * tile_size_x + 14) * (block_size_y * tile_size_y + 14) <= 12288",
    ]
    space = Space.from_dict({"name": "convolution", "parameters": parameters, "constraints": constraints})
    times = np.full((2, len(space)), np.nan)
    for device, rows in enumerate(tables):
        for row in rows:
            if not row["time"].endswith("Config"):  # the name of an error
                index = space.encode({name: int(row[name]) for name in names})
                times[device, index] = float(row["time"])
    return space, times


def best_so_far(space, times, seed, prior=()):
    """The logarithm of the best time over the best there is, after each of 60 measurements."""
    explorer = Explorer(space, ("seconds",), seed=seed, prior=prior, trees=16, candidates=500)
    for _ in range(4):
        proposals = explorer.propose(15)
        measured = [times[proposal.index] for proposal in proposals]
        explorer.tell(
            [proposal.configuration for proposal in proposals],
            [None if np.isnan(time) else {"seconds": float(time)} for time in measured],
        )
    found = times[list(explorer.history.told)]
    found = np.where(np.isnan(found), np.nanmax(times), found)
    return np.log(np.minimum.accumulate(found) / np.nanmin(times))


def test_one_real_gpu_saves_measurements_on_another():
    space, (a100, a4000) = convolution()
    ran = np.flatnonzero(space.allowed_grid)
    prior = [(space.decode(int(i)), None if np.isnan(a100[i]) else {"seconds": float(a100[i])}) for i in ran]
    alone = np.mean([best_so_far(space, a4000, seed) for seed in range(4)], axis=0)
    helped = np.mean([best_so_far(space, a4000, seed, prior) for seed in range(4)], axis=0)
    assert helped.mean() < 0.8 * alone.mean()
