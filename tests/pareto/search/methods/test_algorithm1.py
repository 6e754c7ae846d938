"""The paper's loop: it measures its predicted front, waits for all of it, and stops."""

import numpy as np

from pareto import Explorer
from tests.pareto.searches import OPTIONS, SPACE, explorer_of, measure, spend


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


def test_with_a_batch_algorithm_1_refits_after_so_many_of_its_predicted_front():
    explorer = Explorer(
        SPACE, ("error", "seconds"), seed=1, method="algorithm1", **OPTIONS["algorithm1"], batch=2
    )
    spend(explorer, 12, batch=12)
    predicted = [SPACE.encode(point) for point, _ in explorer.predicted_front(trees=8)]
    asked = explorer.ask(1000)
    assert len(asked) == 2
    assert {SPACE.encode(item) for item in asked} < set(predicted)
    assert explorer.ask(1000) == []


def test_what_algorithm_1_returns_is_all_measured_when_it_stops():
    explorer = explorer_of("algorithm1")
    spend(explorer, len(SPACE))
    predicted = explorer.predicted_front(trees=8)
    assert predicted
    assert {SPACE.encode(point) for point, _ in predicted} <= explorer.history.results.keys()


def test_the_predicted_front_is_ordered_and_no_point_of_it_beats_another():
    explorer = explorer_of("bayesian")
    assert explorer.predicted_front() == []
    spend(explorer, 20)
    values = [list(values.values()) for _, values in explorer.predicted_front(trees=8)]
    assert values == sorted(values)
    assert (np.diff([seconds for _, seconds in values]) <= 0).all()
