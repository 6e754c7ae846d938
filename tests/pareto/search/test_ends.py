"""How far a front may go on beyond its ends: by arithmetic, and where only models of all values can tell."""

import numpy as np
import pytest
from scipy.stats import norm

from pareto import Space
from pareto.fronts.objective import read_objectives
from pareto.search.ends import ENOUGH, beyond_ends
from pareto.search.history import History
from pareto.search.models import BESIDE, BOLD, CAUTIOUS, ENDS, Surrogates
from pareto.search.targets import Targets
from pareto.search.transfer import Trend

FREE = np.array([np.inf, np.inf])
ONES = np.ones(2)


def test_it_is_the_most_that_any_objective_is_expected_to_fall():
    mean, spread = np.array([[-0.5, 2.0], [3.0, -1.0], [-0.5, -0.2]]), np.full((3, 2), 1e-9)
    far = beyond_ends(mean, spread, np.zeros(2), FREE, np.array([1.0, 4.0]))
    np.testing.assert_allclose(far, [0.5, 0.25, 0.5])


def test_what_is_doubtful_counts_with_its_expectation_and_what_is_little_not_at_all():
    rng = np.random.default_rng(0)
    mean, spread = rng.normal(size=(50, 2)), rng.uniform(0.1, 0.5, (50, 2))
    far = beyond_ends(mean, spread, np.zeros(2), FREE, ONES)
    z = -mean / spread
    expected = (spread * (z * norm.cdf(z) + norm.pdf(z))).max(axis=1)
    np.testing.assert_allclose(far, np.where(expected > ENOUGH, expected, 0.0))
    assert 0 < np.count_nonzero(far) < 50


@pytest.mark.parametrize(("second", "chance"), [(0.0, 1.0), (1.0, 0.5), (2.0, 0.0)])
def test_all_other_objectives_must_keep_their_limits(second, chance):
    limits = np.array([np.inf, 1.0])
    far = beyond_ends(np.array([[-1.0, second]]), np.full((1, 2), 1e-3), np.array([0.0, -9.0]), limits, ONES)
    np.testing.assert_allclose(far, chance)


def test_where_the_front_goes_on_far_from_it_only_the_opinion_about_its_ends_says_so():
    """Beside a polished front the second objective is level; it falls where the first is large."""
    space = Space.from_dict(
        {
            "parameters": [
                {"name": "x", "type": "integer", "minimum": 0, "maximum": 39},
                {"name": "y", "type": "integer", "minimum": 0, "maximum": 39},
            ]
        }
    )

    def values(x, y):
        fall = 0.5 * max(0, x - 8) / 31
        return float(np.exp(0.1 * x + 0.004 * y)), float(np.exp(3 - fall - 0.001 * y * (x < 2)))

    history = History(space, read_objectives(("first", "second")), {})
    polished = [(0, y) for y in range(40)] + [(1, y) for y in range(0, 40, 2)]
    for x, y in [*polished, (6, 3), (12, 20), (15, 5), (18, 30), (21, 12)]:
        history.record(space.encode({"x": x, "y": y}), values(x, y))
    targets = Targets.of(history)
    # As if the first were only looked for up to there: what lies beyond the reference is worth nothing.
    beside = Targets(targets.indices, targets.values, targets.limits, np.array([0.3, 3.1]), np.arange(40))
    surrogates = Surrogates(history, beside, Trend.of(history, beside), 600, np.random.default_rng(0))
    far = np.array([space.encode({"x": x, "y": 20}) for x in (28, 32, 36)])
    gain = surrogates.at(far).gains(beside.values[beside.front], np.random.default_rng(0))
    assert gain[[CAUTIOUS, BOLD, BESIDE]].max() < 1e-3 < ENOUGH < gain[ENDS].min()
