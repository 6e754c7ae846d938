"""What is kept of an exploration's measurements is what reading all of them would tell."""

import random
from datetime import timedelta

import pytest
from django.utils import timezone

from crowd.explorations import services
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes import results_cache
from crowd.explorations.outcomes.results_cache import ResultsCache, SearchResults
from crowd.explorations.outcomes.watching import results_of, watch
from crowd.explorations.searching import points
from crowd.explorations.searching.search import FINISHED, SEARCHED

State = Evaluation.State
STEPS = 40


def kept(exploration: Exploration) -> SearchResults:
    seen = watch(exploration.pk)
    assert seen is not None
    return results_of(seen)


def read_anew(exploration: Exploration) -> SearchResults:
    """From all rows at once, in the simplest way."""
    rows = exploration.evaluations.exclude(phase="prior").filter(state__in=FINISHED).order_by("number")
    known = points.measured_points(rows)
    searched = [row for row in rows if row.phase in SEARCHED and row.index is not None]
    searched.sort(key=lambda row: (row.finished_at or row.created_at, row.number))
    return SearchResults(
        points=tuple(known),
        front=tuple(points.best_points(exploration, points.reliable(exploration, known))),
        indices=tuple(row.index for row in searched if row.index is not None),
        values=tuple(row.objectives for row in searched),
        phases=tuple(row.phase for row in searched),
    )


def finish(row: Evaluation, chance: random.Random) -> None:
    """Done or failed with whatever values, perhaps stored later than what was finished after it."""
    values = {"runtime": chance.uniform(0.01, 0.1), "ate_max": chance.choice([0.01, 0.02, 0.04, 0.3])}
    failed = chance.random() < 0.3
    Evaluation.objects.filter(pk=row.pk).update(
        state=State.FAILED if failed else State.DONE,
        objectives=None if failed else values,
        error="no memory" if failed else "",
        attempt=row.attempt + 1,
        finished_at=timezone.now() - timedelta(seconds=chance.choice([0, 0, 10])),
    )


def change(exploration: Exploration, chance: random.Random) -> None:
    """One of the things that happen to an exploration's rows."""
    exploration.refresh_from_db()
    rows = list(exploration.evaluations.order_by("number"))
    finished = [row for row in rows if row.state in FINISHED]
    waiting = [row for row in rows if row.state == State.PENDING]
    step = chance.choice(["measure", "measure", "measure", "again", "retry", "repeat", "raise"])
    if step == "measure" or not finished:
        for row in chance.sample(waiting, min(len(waiting), chance.choice([1, 3]))):
            finish(row, chance)
    elif step == "again":
        finish(chance.choice(finished), chance)
    elif step == "retry":
        services.retry_failures(exploration)
    elif step == "repeat":
        row = chance.choice(finished)
        services.measure_again(exploration, [(row.configuration, row.label)], 2)
    elif step == "raise" and exploration.budget < 20:
        services.raise_budget(exploration, exploration.budget + 2)
    services.advance(exploration.pk)


@pytest.mark.slow
@pytest.mark.parametrize("most_named", [0, results_cache.MAX_KEYS])
@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.exhaustive)])
def test_after_any_changes_it_is_as_if_all_had_been_read_anew(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch, seed: int, most_named: int
) -> None:
    monkeypatch.setattr(results_cache, "MAX_KEYS", most_named)
    chance = random.Random(seed)
    lengths = set()

    for _ in range(STEPS):
        for _ in range(chance.choice([1, 1, 4])):
            change(exploration, chance)
        results = kept(exploration)
        assert results == read_anew(exploration)
        lengths.add((len(results.points), len(results.front), len(results.indices)))

    assert len(lengths) > 5


def test_only_rows_that_are_new_are_read(exploration: Exploration, monkeypatch: pytest.MonkeyPatch) -> None:
    chance = random.Random(0)
    first, second, *_ = services.pending_evaluations(exploration)
    finish(first, chance)
    kept(exploration)
    asked = []
    read = results_cache._rows
    monkeypatch.setattr(results_cache, "_rows", lambda row, keys: asked.append(set(keys)) or read(row, keys))

    finish(second, chance)
    kept(exploration)
    kept(exploration)

    assert asked == [{second.pk}]


def test_where_reading_fails_nothing_is_lost(
    exploration: Exploration, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = random.Random(0)
    rows = services.pending_evaluations(exploration)
    finish(rows[0], chance)
    kept(exploration)
    finish(rows[0], chance)
    finish(rows[1], chance)
    with monkeypatch.context() as broken:
        broken.setattr(results_cache, "_rows", lambda *_: [][0])
        with pytest.raises(IndexError):
            kept(exploration)

    assert kept(exploration) == read_anew(exploration)


def test_only_the_explorations_looked_at_last_are_kept(exploration: Exploration) -> None:
    first = results_cache.cache_of(exploration.pk, exploration.created_at)
    assert results_cache.cache_of(exploration.pk, exploration.created_at) is first

    for number in range(results_cache.MAX_EXPLORATIONS):
        assert isinstance(results_cache.cache_of(-number, exploration.created_at), ResultsCache)

    assert results_cache.cache_of(exploration.pk, exploration.created_at) is not first
