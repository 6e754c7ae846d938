"""The first repeats: which, when, and how many."""

import pytest

from pareto import Censored, Explorer
from pareto.search.first_repeats import PLACE, WORTH
from tests.pareto.searches import SPACE, measure, spend

DEFAULT = SPACE.encode(SPACE.default)


def searched(values=measure, count=40, batch=1, **options):
    """Search, and return the points in their order."""
    explorer = Explorer(SPACE, ("error", "seconds"), initial=60, seed=2, **options)
    return explorer, [SPACE.encode(item) for item in spend(explorer, count, batch, values)]


def repeated(asked):
    """The repeats among `asked`, by place."""
    return {place: index for place, index in enumerate(asked, 1) if index in asked[: place - 1]}


def noisy():
    calls = iter(range(1000))

    def values(configuration):
        one = measure(configuration)
        return one and one | {"seconds": one["seconds"] * (1 + 0.01 * (next(calls) % 7))}

    return values


@pytest.mark.parametrize("batch", [1, 3, 8, 20])
def test_the_default_is_measured_again_within_the_first_measurements(batch):
    _, asked = searched(batch=batch)
    assert repeated(asked)[PLACE] == DEFAULT


@pytest.mark.parametrize("batch", [1, 20])
def test_where_both_agree_one_more_point_is_repeated_and_then_none(batch):
    _, asked = searched(batch=batch)
    first, second = repeated(asked).items()
    assert first == (PLACE, DEFAULT)
    assert second == (max(PLACE, batch) + 1, next(i for i in asked[1:] if measure(SPACE.decode(i))))


@pytest.mark.parametrize("batch", [1, 20])
def test_where_they_differ_so_are_the_default_and_both_ends_of_the_front(batch):
    explorer, asked = searched(noisy(), batch=batch)
    repeats = [*repeated(asked).values()]
    assert repeats.count(DEFAULT) == 2
    assert len(repeats) == 4
    assert set(repeated(asked)) == {PLACE, *range(max(PLACE, batch) + 1, max(PLACE, batch) + 4)}
    before = [index for index in asked[: max(PLACE, batch)] if index != DEFAULT]
    ends = [index for index in repeats if index != DEFAULT]
    seconds = {
        index: explorer.history.results[index][0] for index in before if explorer.history.results[index][0]
    }
    times = {index: values[1] for index, values in seconds.items()}
    assert min(times, key=times.get) in ends


def test_where_the_default_fails_the_first_point_that_succeeds_is_repeated():
    _, asked = searched(lambda item: None if item == SPACE.default else measure(item))
    index = next(i for i in asked[1:] if measure(SPACE.decode(i)))
    assert repeated(asked)[PLACE] == index
    assert DEFAULT not in repeated(asked).values()


def test_where_every_repeat_fails_or_is_censored_few_are_tried():
    seen = set()

    def once(item):
        first = SPACE.encode(item) not in seen
        seen.add(SPACE.encode(item))
        return measure(item) if first else None

    _, asked = searched(once)
    assert len(repeated(asked)) <= 5
    _, asked = searched(lambda _: {"error": Censored(1.0), "seconds": 1.0})
    assert not repeated(asked)


def test_measurements_of_an_earlier_run_are_repeated_at_once_and_its_repeats_count():
    known = [SPACE.decode(index) for index in range(0, 200, 7)]
    explorer = Explorer(SPACE, ("error", "seconds"), initial=60)
    explorer.tell(known, [measure(item) for item in known])
    assert explorer.propose(1)[0].phase == "again"
    explorer.tell(known, [measure(item) for item in known])
    assert explorer.propose(1)[0].phase == "random"


@pytest.mark.parametrize("options", [{"budget": WORTH - 1}, {"rounds": []}])
def test_a_small_budget_and_a_search_with_rounds_have_no_first_repeats(options):
    _, asked = searched(noisy(), **options)
    assert not repeated(asked)


def test_rounds_and_budget_are_restored():
    rounds = [{"error": 1.0, "seconds": 1.0}, {"error": 1.0, "seconds": 1.1}]
    explorer = Explorer(SPACE, ("error", "seconds"), rounds=rounds, budget=9)
    restored = Explorer.restore(SPACE, explorer.state())
    assert restored.state() == explorer.state()
    assert restored.history.rounds == [(1.0, 1.0), (1.0, 1.1)]
    assert restored.budget == 9
