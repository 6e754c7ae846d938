"""When a search measures a configuration once more, and when it does not."""

import json

import numpy as np
import pytest

from pareto import Explorer, Objective
from pareto.search.history import History
from pareto.search.models import Models
from pareto.search.repeats import REPEATS, repeat_gains
from pareto.search.targets import Targets
from pareto.search.trend import Trend
from tests.builders.spaces import space_of
from tests.pareto.searches import advance

SPACE = space_of(x=range(20), y=range(10))


def truth(index, space=SPACE):
    x, y = space.codes([index])[0]
    return np.array([1.0 + x + 0.3 * y, 25.0 - x + 0.5 * y])


def history_of(noise=0.0, count=60, repeated=0):
    """A history of `count` random configurations, the first `repeated` of them measured three times."""
    rng = np.random.default_rng(2)
    history = History(SPACE, (Objective("a"), Objective("b")), {})
    chosen = rng.choice(len(SPACE), count, replace=False).tolist()
    for index in [*chosen, *chosen[:repeated] * 2]:
        history.record(index, tuple(truth(index) * np.exp(noise * rng.standard_normal(2))))
    return history


def gains(history, pending=()):
    targets = Targets.of(history)
    models = Models(history, targets, Trend.of(None, targets), 600, np.random.default_rng(0))
    return repeat_gains(models, pending, np.random.default_rng(0))


def test_where_repeats_agree_another_gains_nothing():
    assert not gains(history_of(repeated=1)).any()


def test_without_a_repeat_nothing_is_gained():
    assert not gains(history_of(noise=0.1)).any()


def test_a_noisy_point_on_the_front_gains_more_than_one_far_behind_it():
    history = history_of(noise=0.1, repeated=10)
    gain = gains(history)
    targets = Targets.of(history)
    assert gain[targets.front].max() > 0
    far = np.argsort(targets.depth)[-20:]
    assert gain[far].max() < 0.1 * gain[targets.front].max()


def test_what_is_pending_is_not_repeated_beside_that():
    history = history_of(noise=0.1, repeated=10)
    gain = gains(history)
    best = int(np.argmax(gain))
    again = gains(history, [[*history.results][best]])
    assert again[best] == 0 < again.max()


def test_more_measurements_of_a_point_gain_less_and_none_after_the_last():
    history = history_of(noise=0.1, repeated=10)
    row = int(np.argmax(gains(history)))
    index = [*history.results][row]
    rng = np.random.default_rng(3)
    while len(history.results[index]) < REPEATS:
        assert gains(history)[row] > 0 or row not in Targets.of(history).front
        history.record(index, tuple(truth(index) * np.exp(0.1 * rng.standard_normal(2))))
    assert gains(history)[row] == 0.0


def test_a_failed_repeat_is_not_tried_again():
    history = history_of(noise=0.1, repeated=10)
    row = int(np.argmax(gains(history)))
    history.record([*history.results][row], None)
    assert gains(history)[row] == 0.0


@pytest.mark.parametrize("objectives", [1, 3, 4])
def test_any_number_of_objectives_has_repeats_to_gain_from(objectives):
    rng = np.random.default_rng(2)
    history = History(SPACE, tuple(Objective(f"y{k}") for k in range(objectives)), {})
    for index in [*rng.choice(len(SPACE), 40, replace=False).tolist(), 7, 7]:
        a, b = truth(index)
        values = np.array([a, b, a + 0.2 * b, 30 - a])[:objectives] * np.exp(
            0.2 * rng.standard_normal(objectives)
        )
        history.record(index, tuple(values))
    gain = gains(history)
    assert np.isfinite(gain).all()
    assert gain.max() > 0 == gain.min()


def explored(noise, budget=60, batch=5, measure=truth, space=SPACE):
    """Search; return the explorer and the phases of what was proposed, in order."""
    rng = np.random.default_rng(1)
    explorer = Explorer(space, ("a", "b"), seed=3, initial=20, candidates=200)
    phases = []

    def noisy(item):
        values = measure(item.index)
        if values is None:
            return None
        return dict(zip("ab", (values * np.exp(noise * rng.standard_normal(2))).tolist(), strict=True))

    while len(phases) < budget and (proposals := advance(explorer, batch, noisy)):
        phases += [item.phase for item in proposals]
    return explorer, phases


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 7, 50])
def test_a_deterministic_program_is_repeated_twice_and_no_more(batch):
    explorer, phases = explored(0.0, batch=batch)
    assert phases.count("again") == 2
    counts = [len(values) for values in explorer.history.results.values()]
    assert sum(counts) - len(counts) == 2


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 7, 50])
def test_a_noisy_program_is_repeated_and_not_too_often(batch):
    explorer, phases = explored(0.1, budget=max(70, 4 * batch), batch=batch)
    assert phases.count("again") >= 5
    assert phases.count("active") > 20
    assert max(len(values) for values in explorer.history.results.values()) <= REPEATS
    state = json.loads(json.dumps(explorer.state()))
    restored = Explorer.restore(SPACE, state)
    assert restored.propose(4) == explorer.propose(4)
    assert restored.state() == explorer.state()


@pytest.mark.slow
def test_a_program_of_which_every_second_measurement_fails_is_not_repeated_for_ever():
    seen = set()

    def once(index):
        if index in seen:
            return None
        seen.add(index)
        return truth(index) * np.exp(0.1 * np.sin(99.0 * index))  # rough: as good as noise

    explorer, phases = explored(0.0, batch=1, measure=once)
    assert phases.count("again") <= REPEATS
    assert max(len(values) for values in explorer.history.results.values()) <= 2


@pytest.mark.slow
def test_a_noisy_program_is_repeated_once_the_space_is_exhausted_until_it_is_finished():
    space = space_of(x=range(10), y=range(4))

    def far_behind_the_front_where_y_is_large(index):
        return truth(index, space) + 5.0 * space.codes([index])[0, 1]

    measure = far_behind_the_front_where_y_is_large
    explorer, _ = explored(0.1, budget=999, batch=20, measure=measure, space=space)
    assert explorer.finished
    assert len(explorer.history.results) == len(space)
    counts = [len(values) for values in explorer.history.results.values()]
    assert REPEATS == max(counts) > min(counts) == 1
