"""The headline of crowds in which some networks invent models, or measure what others measure."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from crowd.records.uncertainty import figure_estimate
from crowd.results.figures import networks, statistics
from crowd.results.figures.networks import WeighedModels
from crowd.results.figures.statistics import Unit
from tests.crowd.figures.test_headline import NOISE, POPULATIONS
from tests.pairs import pairs

# The log ratio that each network measured on a model.
Model = Mapping[str, float]
QUORUM = 3
BOUNDS = math.log(0.5), math.log(36.7)  # of the best of docs/research/device-map-front.json
HOSTILE = (3, 10, 30)
MODELS = (6, 29, 83)
DIRECTIONS = [pytest.param(log, id=name) for log, name in zip(BOUNDS, ("down", "up"), strict=True)]
CROWDS = 2


def weighed(crowd: Sequence[Model], quorum: int = QUORUM) -> WeighedModels:
    models = []
    for model in crowd:
        logs = np.array(list(model.values()))
        deviation = float(logs.std(ddof=1)) if logs.size > 1 else None
        figure = figure_estimate(float(statistics.robust_mean(logs)), deviation, logs.size)
        models.append([(figure, networks.pack(Unit(log, name, 1, 1) for name, log in model.items()))])
    return networks.weigh(models, BOUNDS, quorum)


def headline(crowd: Sequence[Model], quorum: int = QUORUM) -> float:
    """Its logarithm."""
    result = weighed(crowd, quorum)
    return statistics.mean_of(result.figures, result.weights).log


def of_strangers(random: np.random.Generator) -> list[Model]:
    """The honest crowd of tests/services/test_strangers.py: six models of three networks gain 2 times."""
    logs = np.log(2.0) + random.normal(0.0, 0.03, (6, 3))
    return [{f"{model} {network}": log for network, log in enumerate(row)} for model, row in enumerate(logs)]


def of_models(models: int, random: np.random.Generator) -> list[Model]:
    """A fifth of `models` gains 10 times, all others 5 times; 3 to 7 networks each."""
    truths = POPULATIONS["80 % 5x, 20 % 10x"].sample(random, (1, models))[0]
    return [
        {
            f"{model} {network}": truth + random.normal(0.0, NOISE[0][0])
            for network in range(random.integers(3, 8))
        }
        for model, truth in enumerate(truths)
    ]


def crowds(models: int, count: int = CROWDS) -> list[list[Model]]:
    """`count` honest crowds, seed 20; those of 6 models are `of_strangers`."""
    random = np.random.default_rng(20)
    return [of_strangers(random) if models == 6 else of_models(models, random) for _ in range(count)]


def invented(crowd: Sequence[Model], hostile: int, log: float, models: int) -> list[Model]:
    """`crowd` with so many `models` at `log`, each measured by all `hostile` networks."""
    return [*crowd, *({f"hostile {name}": log for name in range(hostile)} for _ in range(models))]


def split(crowd: Sequence[Model], hostile: int, log: float) -> list[Model]:
    """`crowd` with models at `log`, each measured by three `hostile` networks of its own."""
    names = [f"hostile {name}" for name in range(hostile)]
    return [*crowd, *(dict.fromkeys(names[at : at + 3], log) for at in range(0, hostile - 2, 3))]


def joined(crowd: Sequence[Model], hostile: int, log: float) -> list[Model]:
    """`crowd`, in which `hostile` networks measure every model, at `log`."""
    return [{**model, **{f"hostile {name}": log for name in range(hostile)}} for model in crowd]


OUTVOTED = ("every honest model", 6, 30, BOUNDS[1])
ATTACKS = {
    "one invented model": lambda crowd, hostile, log: invented(crowd, hostile, log, 1),
    "12 invented models": lambda crowd, hostile, log: invented(crowd, hostile, log, 12),
    "100 invented models": lambda crowd, hostile, log: invented(crowd, hostile, log, 100),
    "one for three networks": split,
    "every honest model": joined,
    "every honest model, 12 invented": lambda crowd, hostile, log: invented(
        joined(crowd, hostile, log), hostile, log, 12
    ),
}


def shifts(attack: str, models: int, hostile: int, log: float, quorum: int = QUORUM) -> list[float]:
    """How far the headline's logarithm moves in each of `crowds`; a `quorum` of 1: without votes."""
    return [
        headline(ATTACKS[attack](crowd, hostile, log), quorum) - headline(crowd, quorum)
        for crowd in crowds(models)
    ]


@pytest.mark.parametrize("models", MODELS)
@pytest.mark.parametrize("hostile", HOSTILE)
def test_one_invented_model_far_away_counts_like_the_nearest(models: int, hostile: int) -> None:
    [crowd] = crowds(models, 1)
    largest = max(log for model in crowd for log in model.values())

    moved = headline(invented(crowd, hostile, largest + math.log(11), 1)) - headline(crowd)

    assert 0 < moved < 0.04


def most_moved(attack: str, models: int, hostile: int, log: float) -> tuple[float, float]:
    """How far the headline's logarithm moves at most, and what is allowed: k groups of three beside n honest
    models move it by k / (n + k) of the bound's logarithm.
    """
    groups = hostile / QUORUM
    moved = np.abs(shifts(attack, models, hostile, log)).max()
    return float(moved), groups / (models + groups) * BOUNDS[1] + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("attack", "models", "hostile", "log"),
    [cell for cell in pairs(list(ATTACKS), MODELS, HOSTILE, DIRECTIONS) if cell.values != OUTVOTED],
)
def test_networks_move_the_headline_by_their_share_of_the_bound(
    attack: str, models: int, hostile: int, log: float
) -> None:
    moved, allowed = most_moved(attack, models, hostile, log)

    assert moved <= allowed


def test_30_networks_own_the_figures_of_six_models_of_three_honest_ones() -> None:
    moved, allowed = most_moved(*OUTVOTED)

    assert moved > allowed


def test_without_votes_three_networks_own_the_headline() -> None:
    """Twelve models at the bound: from 2.0 to 36.7 times, instead of 2.03."""
    before = np.mean(shifts("12 invented models", 6, 3, BOUNDS[1], quorum=1))
    after = np.mean(shifts("12 invented models", 6, 3, BOUNDS[1]))

    assert math.exp(math.log(2) + before) == pytest.approx(36.7, abs=0.5)
    assert math.exp(math.log(2) + after) == pytest.approx(2.03, abs=0.02)


@pytest.mark.parametrize("models", MODELS)
def test_an_honest_crowd_keeps_its_headline(models: int) -> None:
    for crowd in crowds(models):
        result = weighed(crowd)
        assert result.weights.tolist() == [1.0] * models
        assert headline(crowd) == headline(crowd, quorum=1)
        assert result.networks == len({network for model in crowd for network in model})


@pytest.mark.parametrize("models", MODELS)
def test_a_crowd_of_which_the_same_three_networks_measured_everything_keeps_its_headline(models: int) -> None:
    """A laboratory or a carrier: no network adds more than the others."""
    for crowd in crowds(models):
        few = [{f"{network}": log for network, log in enumerate(list(model.values())[:3])} for model in crowd]
        assert headline(few) == pytest.approx(headline(few, quorum=1), abs=1e-12)
        assert weighed(few).networks == 3


@pytest.mark.parametrize("models", [29, 83])
def test_a_laboratory_of_30_phones_counts_each_of_them_in_full(models: int) -> None:
    """One network with 30 models, which two other networks each confirm, among honest models."""
    for crowd in crowds(models):
        phones = [
            {"laboratory": model["0"], f"one {number}": model["1"], f"two {number}": model["2"]}
            for number, model in enumerate(
                {f"{network}": log for network, log in enumerate(list(each.values())[:3])} for each in crowd
            )
        ][:30]
        result = weighed([*crowd, *phones])
        assert result.weights.tolist() == [1.0] * (models + len(phones))


def test_a_figure_whose_networks_have_equal_votes_stays_as_it_is() -> None:
    crowd = [{"a": 1.0, "b": 1.1, "c": 1.5, "d": 1.05}, {"e": 2.0, "f": 2.1, "g": 2.2}]

    figures = weighed(crowd).figures

    assert [each.log for each in figures] == [
        float(statistics.robust_mean(list(model.values()))) for model in crowd
    ]


def test_a_quorum_of_one_weighs_nothing() -> None:
    crowd = invented(of_strangers(np.random.default_rng(1)), 1, BOUNDS[1], 12)

    assert weighed(crowd, quorum=1).weights.tolist() == [1.0] * 18


def test_models_of_unknown_networks_count_together() -> None:
    """As figures do that were stored before networks were."""
    [figure] = weighed([{"a": 1.0}]).figures
    unknown = [[(figure, networks.pack([Unit(1.0, None, 1, 1)]))], [(figure, b"")]]

    result = networks.weigh(unknown, BOUNDS, QUORUM)

    assert (result.networks, result.weights.tolist()) == (0, [1.0, 1.0])
