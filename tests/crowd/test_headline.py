"""The crowd's figure: a random-effects mean over device models, against simulation."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from crowd.results.figures import statistics

TRUTH = math.log(5.0)


def test_one_or_two_models_have_no_interval() -> None:
    assert statistics.crowd_speedup([]) is None
    both = statistics.crowd_speedup([(math.log(2.0), 0.01), (math.log(8.0), 0.01)])
    assert both == statistics.Interval(pytest.approx(4.0), None, None)


def test_models_that_agree_to_the_last_digit_leave_their_own_uncertainty() -> None:
    """Three figures, each with a standard error of 10 %: the mean's is 10 % over the root of three."""
    crowd = statistics.crowd_speedup([(TRUTH, 0.01)] * 3)

    assert crowd is not None
    assert crowd.low is not None
    assert crowd.value == pytest.approx(5.0)
    half = stats.t.ppf(0.975, 2) * 0.1 / math.sqrt(3)
    # Robustness costs 5 % of the efficiency.
    assert math.log(crowd.value / crowd.low) == pytest.approx(half / math.sqrt(0.95), rel=1e-3)


def test_an_uncertain_figure_weighs_less() -> None:
    crowd = statistics.crowd_speedup([(1.0, 1e-4), (1.02, 1e-4), (1.04, 1e-4), (1.5, 0.25)])

    assert crowd is not None
    assert math.log(crowd.value) == pytest.approx(1.02, abs=0.005)


def test_where_models_differ_by_more_than_their_uncertainty_they_weigh_almost_the_same() -> None:
    logs = [0.5, 1.0, 1.5, 2.0]

    crowd = statistics.crowd_speedup(list(zip(logs, [1e-4, 1e-3] * 2, strict=True)))

    assert crowd is not None
    assert math.log(crowd.value) == pytest.approx(np.mean(logs), abs=0.01)


def test_the_variance_of_a_figure_is_pooled_over_models() -> None:
    variances = statistics.figure_variances([3, 5, 1], [0.1, 0.2, None])

    pooled = (2 * 0.1**2 + 4 * 0.2**2) / 6
    assert variances == pytest.approx([pooled / 3, pooled / 5, pooled])
    assert statistics.figure_variances([1, 1], [None, None]) == pytest.approx([0.0, 0.0])


def simulated(
    random: np.random.Generator, crowds: int, devices: int, between: float, noise: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Figures of CROWDS with so many DEVICES, and their variances: (crowds, devices) both.

    Models differ by BETWEEN, installations of a model and sessions of one by NOISE. Each model has 3 to 7
    installations with 3 sessions.
    """
    people = random.integers(3, 8, (crowds, devices))
    units = random.normal(0.0, math.hypot(noise[0], noise[1] / math.sqrt(3)), (crowds, devices, 7))
    logs, deviations = np.zeros(people.shape), np.zeros(people.shape)
    for count in range(3, 8):
        chosen = people == count
        members = units[chosen][:, :count]
        logs[chosen] = statistics.robust_mean(members)
        deviations[chosen] = members.std(axis=1, ddof=1)
    return logs + random.normal(TRUTH, between, people.shape), variances(people, deviations)


def variances(people: NDArray[np.int64], deviations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of the figures of each crowd, a row each."""
    return np.array(
        [statistics.figure_variances(*row) for row in zip(people, deviations.tolist(), strict=True)]
    )


@pytest.mark.parametrize("devices", [3, 10, 80])
@pytest.mark.parametrize("noise", [(0.05, 0.03), (0.15, 0.03), (0.02, 0.10)])
@pytest.mark.parametrize("between", [0.0, 0.1, 0.4])
def test_the_crowds_interval_covers_the_truth(
    devices: int, noise: tuple[float, float], between: float
) -> None:
    """1,000 crowds each, seed 10; docs/research/coverage.md has what came out."""
    random = np.random.default_rng(10)
    logs, variances = simulated(random, 1_000, devices, between, noise)

    means, errors = statistics.random_effects(logs, variances)

    covered = np.abs(means - TRUTH) <= stats.t.ppf(0.975, devices - 1) * errors
    assert covered.mean() >= 0.93


@pytest.mark.parametrize("devices", [10, 30])
@pytest.mark.parametrize("between", [0.05, 0.15])
@pytest.mark.parametrize("invented", [0.477, 1.0, 4.0])
def test_one_invented_model_in_ten_moves_the_headline_by_less_than_five_per_cent(
    devices: int, between: float, invented: float
) -> None:
    """1,000 crowds each, seed 11; a plain mean moves by up to 49 %."""
    random = np.random.default_rng(11)
    honest, variances = simulated(random, 1_000, devices - devices // 10, between, (0.05, 0.03))
    hostile = np.full((1_000, devices // 10), TRUTH + invented)
    before, _ = statistics.random_effects(honest, variances)

    after, _ = statistics.random_effects(
        np.hstack([honest, hostile]), np.hstack([variances, np.full(hostile.shape, variances.mean())])
    )

    assert math.expm1(np.abs(after - before).mean()) < 0.05


@pytest.mark.parametrize(("devices", "hostile"), [(3, 1), (6, 2)])
@pytest.mark.parametrize("noise", [(0.05, 0.03), (0.15, 0.03)])
def test_hostile_installations_among_honest_ones_move_the_headline_by_less_than_five_per_cent(
    devices: int, hostile: int, noise: tuple[float, float]
) -> None:
    """Models with three honest installations each, and a hostile tenth of all, which joins one of the models.
    They report 20 times its speedup: two that agree with each other are not hidden. 1,000 crowds, seed 12.
    """
    random = np.random.default_rng(12)
    deviation = math.hypot(noise[0], noise[1] / math.sqrt(3))
    models = random.normal(TRUTH, 0.1, (1_000, devices, 1))
    honest = random.normal(models, deviation, (1_000, devices, 3))
    joined = np.hstack([honest[:, 0], np.full((1_000, hostile), TRUTH + math.log(20))])
    logs, deviations = statistics.robust_mean(honest), honest.std(axis=2, ddof=1)
    people = np.full(logs.shape, 3)
    before, _ = statistics.random_effects(logs, variances(people, deviations))
    logs[:, 0], deviations[:, 0] = statistics.robust_mean(joined), joined.std(axis=1, ddof=1)
    people[:, 0] += hostile

    after, errors = statistics.random_effects(logs, variances(people, deviations))

    assert math.expm1(np.abs(after - before).mean()) < 0.05
    assert (np.abs(after - TRUTH) <= stats.t.ppf(0.975, devices - 1) * errors).mean() >= 0.93
