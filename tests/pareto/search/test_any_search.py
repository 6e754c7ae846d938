"""Whatever is searched and whatever comes back, a search keeps its promises."""

import json
import math
import warnings

import hypothesis
import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st

from pareto import Censored, Explorer, Objective
from pareto.search.repeats import REPEATS
from tests.builders.spaces import parameter, space_of

GRID = {"x": range(10), "y": [1, 2, 4, 8], "z": ["a", "b", "c"]}
TILED = parameter(range(1, 9), condition="kind == 'tiled'")
SPACES = [
    space_of(x=range(1, 16)),
    space_of(**GRID),
    space_of("x <= y", **GRID),
    space_of(kind=["plain", "tiled"], tile=TILED, unroll=range(1, 5)),
]
NAMES = ("a", "b", "c", "d")
SHAPES = ("smooth", "rough", "constant", "zero", "negative", "huge", "tiny", "steps")


def shaped(shape, features, number):
    """The value of one objective of a made-up program; no noise."""
    x = float(features @ np.cos(np.arange(len(features)) * (number + 1)))
    return {
        "smooth": 2.0 + x + x * x,
        "rough": 5.0 + x + math.sin(1e4 * x),
        "constant": 7.0,
        "zero": 0.0,
        "negative": -1.0 - abs(x),
        "huge": (2.0 + x) * 1e300,
        "tiny": (3.0 + x * x) * 1e-300,
        "steps": float(round(2 * x)),
    }[shape]


@st.composite
def programs(draw):
    """A space, objectives and a program that measures in it; whether it always measures the same.

    Some of its measurements fail, and of some only a bound of one value is known.
    """
    space = draw(st.sampled_from(SPACES))
    count = draw(st.integers(1, 4))
    shapes = draw(st.lists(st.sampled_from(SHAPES), min_size=count, max_size=count))
    objectives = [Objective(name, draw(st.booleans())) for name in NAMES[:count]]
    limits = {}
    if draw(st.booleans()):
        limits["a"] = draw(st.sampled_from([-1.0, 0.0, 3.0, 1e301]))
    fails = draw(st.sampled_from([0.0, 0.0, 0.3, 0.9, 1.0]))
    noise = draw(st.sampled_from([0.0, 0.0, 0.1, 1.0]))
    flaky = draw(st.sampled_from([0.0, 0.0, 0.3]))
    rng = np.random.default_rng(draw(st.integers(0, 9)))
    broken = rng.random(len(space)) < fails
    bounded = rng.random(len(space)) < draw(st.sampled_from([0.0, 0.0, 0.3, 1.0]))

    def measure(index):
        if broken[index] or rng.random() < flaky:
            return None
        features = space.features(np.array([index]))[0]
        draws = 1.0 + noise * rng.uniform(-1, 1, count)
        values = {
            name: shaped(shape, features, number) * factor
            for number, (name, shape, factor) in enumerate(zip(NAMES, shapes, draws.tolist(), strict=False))
        }
        return values | ({"a": Censored(values["a"])} if bounded[index] else {})

    prior = []
    if draw(st.booleans()):
        known = rng.permutation(space.region.at(np.arange(space.region.size)))[:8].tolist()
        prior = [(space.decode(index), measure(index)) for index in known if space.allowed([index])[0]]
    explorer = Explorer(
        space,
        objectives,
        limits,
        seed=draw(st.integers(0, 3)),
        prior=prior,
        candidates=draw(st.sampled_from([10, 2000])),
        points=draw(st.sampled_from([10, 1000])),
        **draw(st.sampled_from([{}, {"initial": 5}])),
    )
    return explorer, measure, noise == 0.0 and flaky == 0.0


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("ask"), st.sampled_from([1, 1, 3, 10, 50])),
        st.tuples(st.just("tell"), st.sampled_from([0.3, 0.8, 1.0, 1.0])),
        st.tuples(st.just("forget"), st.just(0.5)),
        st.tuples(st.just("restore"), st.none()),
    ),
    min_size=4,
    max_size=24,
)


# The same examples each time: to hunt for more, raise their number with derandomize=False.
@pytest.mark.slow
@pytest.mark.parametrize("examples", [8, pytest.param(60, marks=pytest.mark.exhaustive)])
def test_any_search_asks_for_what_it_may_and_goes_on(examples):
    whatever = settings(max_examples=examples, deadline=None, derandomize=True)
    whatever(hypothesis.given(programs(), STEPS)(asks_for_what_it_may))()


def asks_for_what_it_may(program, steps):
    explorer, measure, deterministic = program
    space = explorer.space
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for step, size in [*steps, ("ask", 1), ("tell", 1.0), ("ask", 50), ("tell", 1.0), ("ask", 1)]:
            pending = [index for index, _ in explorer.history.pending]
            some = [space.decode(index) for index in pending[: math.ceil(len(pending) * (size or 0))]]
            if step == "ask":
                proposals = explorer.propose(size)
                indices = [item.index for item in proposals]
                assert len(set(indices)) + 1 >= len(indices) <= size  # the default may be there twice
                assert not set(indices) & {*pending}
                assert space.allowed(indices).all() if indices else True
                for item in proposals:
                    times = len(explorer.history.results.get(item.index, []))
                    known = times > 0 or indices.count(item.index) == 2
                    assert known and times < REPEATS if item.phase == "again" else times == 0
                assert explorer.finished == (not indices and not pending)
            elif step == "tell":
                explorer.tell(some, [measure(space.encode(item)) for item in some])
            elif step == "forget":
                explorer.forget(some)
            else:
                state = json.loads(json.dumps(explorer.state(), allow_nan=False))
                other = Explorer.restore(space, state)
                assert other.state() == explorer.state()
                assert other.propose(2) == explorer.propose(2)
                explorer = other
        repeats = sum(len(measured) - 1 for measured in explorer.history.results.values())
        assert repeats <= 2 or not deterministic
        recommended = explorer.recommended()
    results = explorer.history.results
    for item in recommended:
        measured = [values for values in results[space.encode(item.configuration)] if values is not None]
        assert not any(isinstance(value, Censored) for values in measured for value in values)
        assert all(low <= item.values[name] <= high for name, (low, high) in item.intervals.items())
        assert all(map(math.isfinite, item.values.values()))
    if deterministic:
        assert [(item.configuration, item.values) for item in recommended] == explorer.front()
