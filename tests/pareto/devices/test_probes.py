"""Which further configurations teach most."""

import numpy as np

from pareto.devices import probes, rungs
from pareto.devices.prediction import Belief, Observation
from tests.pareto.devices.crowd import crowd

# Places 0 and 1 are nearly one thing, 2 stands alone and is well known, 3 alone and hardly known.
COVARIANCE = np.array(
    [[1.0, 0.95, 0.0, 0.0], [0.95, 1.0, 0.0, 0.0], [0.0, 0.0, 0.01, 0.0], [0.0, 0.0, 0.0, 0.8]]
)
BELIEF = Belief(np.zeros(4), COVARIANCE)
ALL = [0, 1, 2, 3]


def test_the_first_teaches_most_and_the_next_something_else() -> None:
    chosen = probes.choose(BELIEF, [], ALL, ALL, 2, seed=0)
    assert chosen[0].place in (0, 1)
    assert chosen[1].place == 3
    assert chosen[0].gains[0] > chosen[0].gains[3] > chosen[0].gains[2]
    assert chosen[0].place not in chosen[1].gains


def test_a_seed_decides_between_nearly_equal_ones() -> None:
    firsts = {probes.choose(BELIEF, [], ALL, ALL, 1, seed=seed)[0].place for seed in range(20)}
    assert firsts == {0, 1}
    again = [probes.choose(BELIEF, [], ALL, ALL, 3, seed=7) for _ in range(2)]
    assert again[0] == again[1]


def test_what_relatives_lack_counts_by_the_relation() -> None:
    updated = BELIEF.after(Observation(np.array([0, 1]), np.zeros(2), np.full(2, 0.01)))
    unrelated = Belief(updated.mean, updated.covariance * 1.0, relation=0.0)
    related = Belief(updated.mean, updated.covariance, relation=0.9)
    alone = probes.choose(unrelated, [BELIEF], [0, 2], ALL, 1, seed=0)
    together = probes.choose(related, [BELIEF], [0, 2], ALL, 1, seed=0)
    assert alone[0].place == 2
    assert together[0].place == 0


def test_chosen_ones_teach_more_than_random_ones() -> None:
    device_map = crowd(families=8, each=1, noise=0.05)
    belief = rungs.stages(device_map)
    open_places = [place for place, name in enumerate(device_map.ratios.columns) if name.startswith("probe")]

    def left(places: list[int]) -> float:
        after = belief.after(Observation(np.array(places), belief.mean[places], np.full(3, probes.ERROR)))
        return float((after.deviation[open_places] ** 2).sum())

    chosen = [one.place for one in probes.choose(belief, [], open_places, open_places, 3, seed=1)]
    random = np.random.default_rng(0)
    others = [left(list(random.choice(open_places, 3, replace=False))) for _ in range(20)]
    assert left(chosen) < np.median(others)


def test_no_more_than_there_are() -> None:
    assert len(probes.choose(BELIEF, [], [1, 3], ALL, 5, seed=0)) == 2
    assert probes.choose(BELIEF, [], [], ALL, 3, seed=0) == []
