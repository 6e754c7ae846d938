"""The paper's loop: it measures its predicted front, waits for all of it, and stops."""

from tests.pareto.searches import SPACE, explorer_of, measure, spend


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
