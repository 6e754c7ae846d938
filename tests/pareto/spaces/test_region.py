"""Spaces with constraints: what is allowed, how much of it there is, its neighbours, and drawing from it."""

import copy
import pickle
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto import Explorer, Space
from pareto.errors import ConstraintError, ForbiddenError, SpaceError
from pareto.search.methods import METHODS
from pareto.spaces import region
from pareto.spaces.sampling import sample, spread_sample
from tests.builders import convolution
from tests.builders.spaces import described, parameter, space_of
from tests.pareto.searches import repeats_in, spend

KERNEL = described(
    "block_x * block_y <= 512",
    "tiling == 'none' or unroll >= 2",
    block_x=parameter([16, 32, 64, 128, 256], default=32),
    block_y=parameter([1, 2, 4, 8, 16, 32], default=4),
    tiling=["none", "rows", "blocks"],
    unroll=range(1, 5),
    fast=bool,
)


def keeps(configuration) -> bool:
    return configuration["block_x"] * configuration["block_y"] <= 512 and (
        configuration["tiling"] == "none" or configuration["unroll"] >= 2
    )


def numbered(constraints, values=100, parameters=6) -> Space:
    """Return a space of `parameters` numbers 1 .. `values` named p0, p1, .."""
    return space_of(*constraints, **{f"p{i}": range(1, values + 1) for i in range(parameters)})


CONDITIONS = st.lists(
    st.sampled_from(
        [
            "p0 + p1 <= 4",
            "p1 == p2",
            "p0 * p1 * p2 * p3 % 2 == 0",
            "p3 > p0 or p2 == 1",
            "p2 in [1, 3]",
            "p0 <= p1 <= p3",
            "p0 + p1 + p2 + p3 <= 9",
        ]
    ),
    unique=True,
    max_size=4,
)


def test_allowed_points_are_those_that_keep_every_constraint():
    space = Space.from_dict(KERNEL)
    expected = [keeps(space.decode(index)) for index in range(len(space))]
    assert len(space) == 5 * 6 * 3 * 4 * 2  # the product: an index never depends on constraints
    assert space.allowed(range(len(space))).tolist() == expected
    assert space.allowed_grid.tolist() == expected
    assert space.count_allowed().points == sum(expected)
    assert space.count_allowed().exact
    assert str(space.count_allowed()) == str(sum(expected))


def test_without_constraints_everything_is_allowed():
    space = Space.from_dict({**KERNEL, "constraints": []})
    assert space.allowed([0, len(space) - 1]).tolist() == [True, True]
    assert space.allowed_grid.all()
    assert space.count_allowed().points == len(space)
    assert space.constraints == ()


def test_many_points_are_evaluated_in_chunks_that_agree_with_the_grid(monkeypatch):
    monkeypatch.setattr(region, "CHUNK", 7)
    space = Space.from_dict(KERNEL)
    order = np.random.default_rng(0).permutation(len(space))
    assert (space.allowed(order) == space.allowed_grid[order]).all()


def test_a_forbidden_configuration_is_refused_naming_constraint_and_values():
    space = Space.from_dict(KERNEL)
    forbidden = {**space.default, "block_x": 256, "block_y": 32}
    with pytest.raises(
        ForbiddenError, match=r"block_x = 256, block_y = 32 breaks .*'block_x \* block_y <= 512'"
    ):
        space.encode(forbidden)
    assert space.decode(space.index_of(forbidden)) == forbidden
    assert not space.allowed([space.index_of(forbidden)])[0]


def test_neighbours_are_allowed():
    space = Space.from_dict(KERNEL)
    here = space.encode({**space.default, "block_x": 128, "block_y": 4})
    neighbours = space.neighbours(here)
    assert all(keeps(space.decode(int(index))) for index in neighbours)
    free = Space.from_dict({**KERNEL, "constraints": []})
    assert neighbours.tolist() == [i for i in free.neighbours(here) if keeps(free.decode(int(i)))]
    assert len(neighbours) < len(free.neighbours(here))


def test_constraints_survive_json_and_are_part_of_the_identity(tmp_path):
    space = Space.from_dict(KERNEL)
    space.save(tmp_path / "kernel.json")
    again = Space.load(tmp_path / "kernel.json")
    assert again == space
    assert again.digest == space.digest
    free = Space.from_dict({**KERNEL, "constraints": []})
    other = Space.from_dict({**KERNEL, "constraints": KERNEL["constraints"][:1]})
    assert len({space.digest, free.digest, other.digest}) == 3
    assert space != free
    assert "constraints" not in free.to_dict()


def test_a_space_with_constraints_is_copied_and_pickled():
    space = Space.from_dict(KERNEL)
    assert space.count_allowed().exact
    again = pickle.loads(pickle.dumps(copy.deepcopy(space)))
    assert again == space
    assert (again.allowed_grid == space.allowed_grid).all()


def test_contradicting_constraints_are_refused():
    with pytest.raises(ConstraintError, match="'p0 > p1', 'p1 > p2', 'p2 > p0': they contradict each other"):
        numbered(["p0 > p1", "p1 > p2", "p2 > p0"], values=5, parameters=3)


def test_a_given_default_that_is_forbidden_is_refused_with_an_example():
    defaults = {"block_x": parameter([64, 128, 256], default=256), "block_y": parameter([1, 2, 4], default=4)}
    message = r"the default breaks .*'block_x \* block_y <= 512'.*such as \{'block_(x': 128|y': 2)\}"
    with pytest.raises(ConstraintError, match=message):
        space_of("block_x * block_y <= 512", **defaults)


def test_a_default_that_nobody_gave_moves_to_an_allowed_value_near_it():
    space = numbered(["p0 >= 40", "p1 == p2 + 2"])
    assert space.default == {"p0": 40, "p1": 3, "p2": 1, "p3": 1, "p4": 1, "p5": 1}
    linked = numbered(["p0 * p1 * p2 * p3 * p4 * p5 >= 10 ** 9"])
    assert linked.region.open
    assert linked.allowed([linked.encode(linked.default)])[0]
    assert Space.from_dict(linked.to_dict()) == linked


@settings(deadline=None, max_examples=60)
@given(CONDITIONS, st.sampled_from([1, 20, 2**22]), st.integers(0, 2**32))
def test_every_allowed_point_is_counted_drawn_once_and_numbered_once(conditions, largest_join, seed):
    """However much is tabulated: nothing (largest join 1), some, or all of the constraints."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(region, "LARGEST_JOIN", largest_join)
        patch.setattr(region, "CHUNK", 2**10)
        patch.setattr(region, "DRAWS", 2**14)
        try:
            space = numbered(conditions, values=4, parameters=4)
        except SpaceError:
            return  # no allowed default was found among the drawn points
        every = np.flatnonzero(space.allowed_grid)
        rng = np.random.default_rng(seed)
        product = space.region.at(np.arange(space.region.size))
        assert len(np.unique(product)) == space.region.size
        assert np.isin(every, product).all()
        assert sorted(product[space.region.keeps(product)].tolist()) == every.tolist()
        count = space.count_allowed()
        assert abs(count.points - len(every)) <= 5 * count.error
        assert count.exact == (not space.region.open)
        assert sorted(sample(space, len(space), rng).tolist()) == every.tolist()
        some, spread = (
            sample(space, 5, rng, every[:3], 2**14),
            spread_sample(space, 8, rng, every[:3], 2**14),
        )
        assert len(set(some.tolist())) == len(some) == min(5, max(len(every) - 3, 0))
        assert len(set(spread.tolist())) == len(spread) == min(8, max(len(every) - 3, 0))
        assert space.allowed(some).all()
        assert space.allowed(spread).all()
        assert not np.isin([*some, *spread], every[:3]).any()


@pytest.mark.parametrize("largest_join", [1, 2**22])
def test_draws_under_constraints_are_uniform(monkeypatch, largest_join):
    monkeypatch.setattr(region, "LARGEST_JOIN", largest_join)
    space = numbered(["p0 + p1 <= 8", "p2 % p0 == 0"], values=9, parameters=3)
    every = np.flatnonzero(space.allowed_grid)
    rng = np.random.default_rng(0)
    drawn = Counter(index for _ in range(1000) for index in sample(space, 20, rng).tolist())
    assert set(drawn) == set(every.tolist())
    expected = 1000 * 20 / len(every)
    # Without replacement the variance is a little below that of a binomial: chi-square with len - 1 freedoms.
    chi_square = sum((drawn[index] - expected) ** 2 / expected for index in every.tolist())
    assert chi_square < len(every) + 5 * np.sqrt(2 * len(every))


def test_a_million_million_points_of_which_one_in_a_hundred_million_is_allowed():
    space = numbered(["p0 == p1", "p2 == p3", "p4 == p5 + 50", "p0 < 99 or p2 > 7", "p4 > 99"])
    assert len(space) == 10**12
    assert space.count_allowed().points == 100 * 100 - 2 * 7
    drawn = sample(space, 5000, np.random.default_rng(0))
    assert len(np.unique(drawn)) == 5000
    assert space.allowed(drawn).all()
    assert len(sample(space, 20_000, np.random.default_rng(0))) == 9986


def test_one_point_in_a_thousand_of_a_constraint_that_links_everything():
    space = numbered(["(p0 + 3 * p1 + 7 * p2 + 11 * p3 + 13 * p4 + 17 * p5) % 1000 == 0"])
    assert space.region.open
    count = space.count_allowed()
    assert not count.exact
    assert count.points == pytest.approx(1e9, rel=0.1)
    assert count.error == pytest.approx(1e9 / np.sqrt(region.DRAWS / 1000), rel=0.1)
    drawn = sample(space, 200, np.random.default_rng(0))
    assert len(np.unique(drawn)) == 200
    assert space.allowed(drawn).all()


def test_a_large_join_that_drops_nearly_everything_comes_first_where_small_ones_would_outgrow_it(monkeypatch):
    monkeypatch.setattr(region, "LARGEST_JOIN", 4**4)
    space = numbered(["p0 + p1 + p2 + p3 == 4", "p3 <= p4", "p4 <= p5"], values=4)
    assert not space.region.open
    assert space.count_allowed().points == sum(5 - p4 for p4 in range(1, 5)) == space.allowed_grid.sum()


def test_an_exhausted_space_gives_fewer(monkeypatch):
    monkeypatch.setattr(region, "LARGEST_JOIN", 1)
    space = numbered(["p0 * p1 * p2 * p3 * p4 * p5 <= 2"])  # seven points of 10^12: too rare to be met
    assert len(sample(space, 3, np.random.default_rng(0), draws=2**17)) == 0
    assert space.count_allowed().points <= space.count_allowed().error


def test_a_spread_sample_is_even_along_what_constraints_link():
    space = numbered(["p0 <= p1", "p2 != 3"], values=20, parameters=4)
    codes = space.codes(spread_sample(space, 190, np.random.default_rng(1)))
    free = np.bincount(codes[:, 3], minlength=20)
    assert np.ptp(free) <= 1
    assert np.ptp(np.bincount(codes[:, 2], minlength=20)[np.arange(20) != 2]) <= 1
    # 210 pairs p0 <= p1, in 190 strata: each p0 comes up about as often as it has partners.
    assert np.abs(np.bincount(codes[:, 0], minlength=20) - np.arange(20, 0, -1) * 190 / 210).max() <= 2


def test_an_exploration_measures_every_allowed_point_once_and_ends():
    space = Space.from_dict(KERNEL)
    explorer = Explorer(space, ("time", "error"), method="random")
    seen = spend(explorer, len(space), 100, lambda item: {"time": item["block_x"], "error": item["unroll"]})
    assert sorted(space.encode(item) for item in seen) == np.flatnonzero(space.allowed_grid).tolist()


def test_the_convolution_table_is_what_its_known_constraints_allow():
    rows = [configuration for configuration, _ in convolution.measured("A100")]
    space = convolution.space()
    assert sorted(space.index_of(row) for row in rows) == np.flatnonzero(space.allowed_grid).tolist()
    assert space.count_allowed().points == len(rows) == 4362


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_every_method_measures_allowed_points_only_and_two_again_at_most(method):
    space = Space.from_dict(KERNEL)
    explorer = Explorer(space, ("time", "error"), method=method, seed=1)

    def measured(item):
        time = 1 + item["block_x"] / item["block_y"]
        return {"time": time, "error": 1 + abs(item["unroll"] - 2) + item["block_y"]}

    seen = spend(explorer, 240, 60, measured)
    assert len(seen) >= 200
    assert repeats_in(seen, space) <= 2 * (method == "bayesian")
    assert space.allowed([space.encode(item) for item in seen]).all()
