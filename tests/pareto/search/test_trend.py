"""What another device lets expect: trusted as far as it is confirmed, and ignored when wrong."""

import numpy as np
import pytest

from pareto import Explorer, Objective
from pareto.fronts.front import nondominated
from pareto.search.history import History
from pareto.search.prior import Prior
from pareto.search.targets import Targets
from pareto.search.trend import Trend, trusted
from tests.builders import convolution
from tests.pareto.search.made_up_devices import CODES, SOURCE, SPACE, TARGET, pairs, some_of_the_source
from tests.pareto.searches import advance


def evaluations_needed(seed, prior=(), target=TARGET, budget=120, within=1.15):
    """How many measurements until one is `within` of the target's best; one more than the budget if none."""
    explorer = Explorer(SPACE, ("seconds",), seed=seed, prior=prior, initial=12)
    good = target.min() * within
    for done in range(0, budget, 6):
        proposals = advance(explorer, 6, lambda item: {"seconds": float(target[item.index])})
        measured = [target[proposal.index] for proposal in proposals]
        if min(measured) <= good:
            return done + 1 + int(np.argmax(np.array(measured) <= good))
    return budget + 1


def history_of(values, indices):
    history = History(SPACE, (Objective("seconds"),), {})
    for index in indices:
        history.record(int(index), (float(values[index]),))
    return history


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "sign"), [(SOURCE, 1), (1 / SOURCE, -1), (np.random.default_rng(6).permutation(SOURCE), 0)]
)
def test_the_trend_follows_the_source_as_far_as_it_is_confirmed(source, sign):
    prior = Prior.read(SPACE, (Objective("seconds"),), {}, pairs(source, range(len(SPACE))))
    history = history_of(TARGET, np.random.default_rng(7).choice(len(SPACE), 40, replace=False))
    targets = Targets.of(history)
    trend = Trend.of(prior, targets)
    assert np.sign(trend.slope[0]) == sign
    assert trusted(history, prior) == (sign > 0)
    everywhere = trend(np.arange(len(SPACE)))[:, 0]
    if sign:
        assert np.corrcoef(everywhere, np.log(TARGET))[0, 1] > 0.5
    else:
        assert not everywhere.any()


@pytest.fixture(scope="module")
def alone():
    """Measurements needed without a prior, by seed."""
    return [evaluations_needed(seed) for seed in range(5)]


@pytest.mark.slow
def test_a_related_device_saves_measurements(alone):
    helped = [evaluations_needed(seed, some_of_the_source()) for seed in range(5)]
    # Both begin with 12 and repeat two; what is saved is of the others.
    assert np.mean(helped) - 14 < 0.5 * (np.mean(alone) - 14), (helped, alone)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [1 / SOURCE, np.random.default_rng(6).permutation(SOURCE)])
def test_a_device_that_is_the_opposite_or_says_nothing_costs_little(alone, wrong):
    misled = [evaluations_needed(seed, some_of_the_source(wrong)) for seed in range(2)]
    # What it may cost is its share of the first configurations, half of 12, and a batch until it is refuted.
    assert np.mean(misled) <= np.mean(alone[:2]) + 12, (misled, alone)


@pytest.mark.slow
def test_objectives_are_trusted_one_by_one():
    """An error that no device changes, and a time that says nothing: the front is found all the same."""
    error = 1.0 / (1 + CODES[:, 0]) + 0.02 * CODES[:, 2]
    noise = np.random.default_rng(9).permutation(SOURCE)
    measurements = [
        (SPACE.decode(int(i)), {"error": float(error[i]), "seconds": float(noise[i])})
        for i in np.random.default_rng(3).choice(len(SPACE), 200, replace=False)
    ]
    explorer = Explorer(SPACE, ("error", "seconds"), prior=measurements, initial=24)
    for _ in range(8):
        advance(
            explorer,
            10,
            lambda item: {"error": float(error[item.index]), "seconds": float(TARGET[item.index])},
        )
    slope = Trend.of(explorer._method.prior, Targets.of(explorer.history)).slope
    assert slope[0] > 0.5
    assert abs(slope[1]) < 0.3
    truth = np.stack([error, TARGET], axis=1)
    values = np.array([list(values.values()) for _, values in explorer.front()])
    true_front = truth[nondominated(truth)]
    near = [(np.log(values / point).max(axis=1)).min() for point in true_front]
    assert np.median(near) < 0.1


def seconds_of(time):
    return None if np.isnan(time) else {"seconds": float(time)}


def best_so_far(space, times, seed, prior=()):
    """The logarithm of the best time over the best there is, after each of 45 measurements."""
    explorer = Explorer(space, ("seconds",), seed=seed, prior=prior, candidates=500)
    found = np.empty(0)
    for _ in range(3):
        proposals = advance(explorer, 15, lambda item: seconds_of(times[item.index]))
        measured = times[[proposal.index for proposal in proposals]]
        found = np.append(found, np.where(np.isnan(measured), np.nanmax(times), measured))
    return np.log(np.minimum.accumulate(found) / np.nanmin(times))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(0, marks=pytest.mark.exhaustive)])
def test_one_real_gpu_saves_measurements_on_another(seed):
    space = convolution.space()
    times = np.full((2, len(space)), np.nan)
    for device, name in enumerate(("A100", "A4000")):
        for configuration, seconds in convolution.measured(name):
            times[device, space.encode(configuration)] = np.nan if seconds is None else seconds
    a100, a4000 = times
    known = np.flatnonzero(space.allowed_grid)[::4]
    prior = [(space.decode(int(index)), seconds_of(a100[index])) for index in known]
    assert best_so_far(space, a4000, seed, prior).mean() < 0.8 * best_so_far(space, a4000, seed).mean()
