"""The crowd's figure: the mean over device models with both of its intervals, against simulation."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from crowd.records.uncertainty import EFFICIENCY, TYPICAL_DEVIATION, Estimate, figure_estimate
from crowd.results.figures import statistics
from crowd.results.figures.statistics import CrowdSpeedup

Logs = NDArray[np.float64]
TRUTH = math.log(5.0)
SIZES = (10, 29, 83)
# Standard deviations of log ratios, between installations of one model and between sessions of one.
NOISE = [(0.05, 0.03), (0.15, 0.03), (0.02, 0.10)]
WITHIN_FAMILY = 0.05
# Crowds that are drawn: those of docs/research/coverage.md, and enough of them for the normal run.
DRAWN = [pytest.param(250, id="250"), pytest.param(1_000, id="1000", marks=pytest.mark.exhaustive)]


def fewest(crowds: int) -> float:
    """The share of so many intervals of 95 % that cover, at least: 2.9 standard deviations of the binomial
    below it. It is 0.93 for 1,000.
    """
    return 0.95 - 2.9 * math.sqrt(0.95 * 0.05 / crowds)


@dataclass(frozen=True)
class Population:
    """All models that might be measured: the mean of their log ratios, and samples of them."""

    mean: float
    sample: Callable[[np.random.Generator, tuple[int, int]], Logs]


def normal(deviation: float) -> Population:
    return Population(TRUTH, lambda random, shape: random.normal(TRUTH, deviation, shape))


def mixture(share: float, usual: float, fast: float) -> Population:
    """A `share` of the models belongs to a family of chips that gains `fast`, all others gain `usual`."""

    def sample(random: np.random.Generator, shape: tuple[int, int]) -> Logs:
        centres = np.where(random.random(shape) < share, math.log(fast), math.log(usual))
        return np.asarray(random.normal(centres, WITHIN_FAMILY))

    return Population((1 - share) * math.log(usual) + share * math.log(fast), sample)


def skewed(shape: float) -> Population:
    """Gamma with this `shape` (1: exponential) and a standard deviation of 0.4."""
    scale = 0.4 / math.sqrt(shape)
    return Population(TRUTH, lambda random, size: TRUTH + scale * (random.gamma(shape, size=size) - shape))


POPULATIONS = {
    "normal, 0.1": normal(0.1),
    "normal, 0.4": normal(0.4),
    "80 % 5x, 20 % 10x": mixture(0.2, 5.0, 10.0),
    "90 % 5x, 10 % 12x": mixture(0.1, 5.0, 12.0),
    "log-uniform, 2x to 12x": Population(
        math.log(24) / 2, lambda random, shape: random.uniform(math.log(2), math.log(12), shape)
    ),
    "skewed, gamma 4": skewed(4.0),
    "skewed, gamma 2": skewed(2.0),
    "skewed, exponential": skewed(1.0),
}


def measured(
    random: np.random.Generator, models: Logs, noise: tuple[float, float] = NOISE[0]
) -> list[list[Estimate]]:
    """The figures of `models` (crowds, n) with 3 to 7 installations each, of 3 sessions."""
    people = random.integers(3, 8, models.shape)
    units = random.normal(0.0, math.hypot(noise[0], noise[1] / math.sqrt(3)), (*models.shape, 7))
    logs, deviations = models.copy(), np.zeros(models.shape)
    for count in range(3, 8):
        members = units[people == count][:, :count]
        logs[people == count] += statistics.robust_mean(members)
        deviations[people == count] = members.std(axis=1, ddof=1)
    return [
        [figure_estimate(*columns) for columns in zip(*row, strict=True)]
        for row in zip(logs.tolist(), deviations.tolist(), people.tolist(), strict=True)
    ]


def headlines(crowds: list[list[Estimate]]) -> list[CrowdSpeedup]:
    found = [statistics.crowd_speedup(crowd) for crowd in crowds]
    return [each for each in found if each is not None]


def measured_coverage(
    population: Population, models: int, crowds: int, noise: tuple[float, float] = NOISE[0]
) -> float:
    """How often the interval for the mean of the models measured contains it. Seed 10."""
    random = np.random.default_rng(10)
    sample = population.sample(random, (crowds, models))
    found = [each.measured for each in headlines(measured(random, sample, noise))]
    hits = [
        (each.low or math.inf) <= math.exp(mean) <= (each.high or 0)
        for each, mean in zip(found, sample.mean(axis=1), strict=True)
    ]
    return float(np.mean(hits))


def population_coverage(population: Population, models: int, crowds: int = 4_000) -> float:
    """How often the interval for the mean of all models contains it. Seed 10."""
    random = np.random.default_rng(10)
    noise = math.hypot(NOISE[0][0], NOISE[0][1] / math.sqrt(3)) / math.sqrt(5)
    sample = population.sample(random, (crowds, models))
    low, high = statistics.sample_interval(sample + random.normal(0.0, noise, sample.shape))
    return float(((low <= population.mean) & (population.mean <= high)).mean())


def test_one_or_two_models_of_few_installations_have_no_interval() -> None:
    assert statistics.crowd_speedup([]) is None
    both = statistics.crowd_speedup([figure_estimate(math.log(each), None, 1) for each in (2.0, 8.0)])

    assert both is not None
    assert both.measured == statistics.Interval(pytest.approx(4.0), None, None)


def test_the_interval_of_one_model_is_its_own() -> None:
    [alone] = headlines([[figure_estimate(TRUTH, 0.1, 4)]])

    half = stats.t.ppf(0.975, 3) * 0.1 / 2 / math.sqrt(EFFICIENCY)
    assert alone.measured.low == pytest.approx(5.0 * math.exp(-half))
    assert alone.population.low is None


def test_the_headline_is_the_mean_however_the_models_differ() -> None:
    """A minority that is 2.4 times as fast counts like all others, whatever its uncertainty."""
    logs = [TRUTH] * 9 + [math.log(12.0)]

    [crowd] = headlines([[figure_estimate(log, 0.02 * place, 4) for place, log in enumerate(logs)]])

    assert crowd.measured.value == pytest.approx(math.exp(np.mean(logs)))


def test_the_uncertainty_of_a_figure_is_that_between_its_units() -> None:
    assert figure_estimate(1.0, 0.1, 4) == Estimate(1.0, pytest.approx(0.05 / math.sqrt(EFFICIENCY)), 3)
    # Units that agree to the last digit do so by chance.
    assert figure_estimate(1.0, 0.0, 4) == Estimate(1.0, pytest.approx(0.005 / math.sqrt(EFFICIENCY)), 3)


def test_the_uncertainty_of_a_figure_of_few_units_is_assumed() -> None:
    one, two = figure_estimate(1.0, None, 1), figure_estimate(1.0, 0.3, 2)
    noisy = figure_estimate(1.0, None, 1, math.exp(1 - 0.6364), math.exp(1 + 0.6364))

    assert (one.error, one.assumed) == (pytest.approx(TYPICAL_DEVIATION), True)
    assert two.error == pytest.approx(math.sqrt((0.3**2 + 2 * TYPICAL_DEVIATION**2) / 3 / 2))
    assert noisy.error == pytest.approx(0.2)


@pytest.mark.slow
@pytest.mark.parametrize("crowds", DRAWN)
@pytest.mark.parametrize("models", SIZES)
@pytest.mark.parametrize("population", POPULATIONS.values(), ids=POPULATIONS)
def test_the_interval_covers_the_mean_of_the_models_measured(
    population: Population, models: int, crowds: int
) -> None:
    """docs/research/coverage.md has what came out."""
    assert measured_coverage(population, models, crowds) >= fewest(crowds)


@pytest.mark.slow
@pytest.mark.parametrize("crowds", DRAWN)
@pytest.mark.parametrize("models", [3, *SIZES])
@pytest.mark.parametrize("noise", NOISE[1:])
def test_the_interval_covers_the_mean_of_the_models_with_more_noise(
    models: int, noise: tuple[float, float], crowds: int
) -> None:
    assert measured_coverage(normal(0.1), models, crowds, noise) >= fewest(crowds)


@pytest.mark.parametrize("models", SIZES)
@pytest.mark.parametrize("population", POPULATIONS.values(), ids=POPULATIONS)
def test_the_wider_interval_covers_the_mean_of_all_models(population: Population, models: int) -> None:
    """4,000 crowds each. Of crowds with 10 models, 35 % hold none of a tenth of all models."""
    rare_family = models == 10 and population in (
        POPULATIONS["80 % 5x, 20 % 10x"],
        POPULATIONS["90 % 5x, 10 % 12x"],
    )
    assert (population_coverage(population, models) >= 0.93) is not rare_family


def test_a_small_crowd_says_nothing_of_all_models() -> None:
    random = np.random.default_rng(1)
    small, large = (
        headlines(measured(random, normal(0.1).sample(random, (1, size))))[0] for size in (28, 29)
    )

    assert small.population.low is None
    assert large.population.low is not None
    assert large.measured.low is not None
    assert large.population.low <= large.measured.low


def shift(models: int, between: float, invented: float, crowds: int = 200) -> float:
    """The mean shift of the headline by an invented tenth of `models`, at log ratio TRUTH + `invented`.

    Seed 11.
    """
    random = np.random.default_rng(11)
    count = models // 10
    honest = measured(random, random.normal(TRUTH, between, (crowds, models - count)))
    hostile = [figure_estimate(TRUTH + invented, 0.02, 3)] * count
    moved = [
        math.log(after.measured.value / before.measured.value)
        for before, after in zip(
            headlines(honest), headlines([[*crowd, *hostile] for crowd in honest]), strict=True
        )
    ]
    return math.expm1(np.abs(moved).mean())


@pytest.mark.slow
@pytest.mark.parametrize("models", [10, 30])
@pytest.mark.parametrize("between", [0.05, 0.15])
@pytest.mark.parametrize("invented", [3.0, 4.0])
def test_an_invented_tenth_that_is_far_away_moves_the_headline_by_less_than_five_per_cent(
    models: int, between: float, invented: float
) -> None:
    """A plain mean moves by 35 and 49 %."""
    assert shift(models, between, invented) < 0.05


@pytest.mark.parametrize("invented", [0.477, 0.875])
def test_an_invented_model_moves_the_headline_no_farther_than_an_honest_one(invented: float) -> None:
    """What might be a family of chips counts: at most by its share."""
    assert shift(10, 0.15, invented) == pytest.approx(math.expm1(invented / 10), abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("drawn", DRAWN)
@pytest.mark.parametrize(("devices", "hostile"), [(3, 1), (6, 2)])
@pytest.mark.parametrize("noise", NOISE[:2])
def test_hostile_installations_among_honest_ones_move_the_headline_by_less_than_five_per_cent(
    devices: int, hostile: int, noise: tuple[float, float], drawn: int
) -> None:
    """Models with three honest installations each, and a hostile tenth of all, which joins one of the models.
    They report 20 times its speedup: two that agree with each other are not hidden. Seed 12.
    """
    random = np.random.default_rng(12)
    deviation = math.hypot(noise[0], noise[1] / math.sqrt(3))
    models = random.normal(TRUTH, 0.1, (drawn, devices, 1))
    moved, hits = [], []
    crowds = random.normal(models, deviation, (drawn, devices, 3))
    for truth, units in zip(models[..., 0], crowds, strict=True):
        honest, attacked = (
            statistics.crowd_speedup(
                [
                    figure_estimate(float(statistics.robust_mean(each)), each.std(ddof=1), each.size)
                    for each in (first, *units[1:])
                ]
            )
            for first in (units[0], np.append(units[0], [TRUTH + math.log(20)] * hostile))
        )
        assert honest is not None
        assert attacked is not None
        after = attacked.measured
        moved.append(abs(math.log(after.value / honest.measured.value)))
        hits.append((after.low or math.inf) <= math.exp(truth.mean()) <= (after.high or 0))

    assert math.expm1(np.mean(moved)) < 0.05
    assert np.mean(hits) >= fewest(drawn)
