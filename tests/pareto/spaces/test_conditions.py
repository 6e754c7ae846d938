"""Conditional parameters: what is inactive makes no difference anywhere."""

import csv
import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto import Explorer, Space
from pareto.errors import ConfigurationError, ConstraintError, ForbiddenError, SpaceError
from pareto.fronts.objective import read_objectives
from pareto.measuring.folder import Folder
from pareto.measuring.measurements import read_measurements
from pareto.measuring.table import from_table
from pareto.plot.page import page
from pareto.search.methods import METHODS
from pareto.spaces import region
from pareto.spaces.sampling import sample, spread_sample
from tests.builders.spaces import described, parameter, space_of
from tests.pareto.conftest import explore, rows
from tests.pareto.searches import repeats_in, spend

BLOCK = parameter([8, 16, 32], default=16)
ALGORITHMS = ["plain", "blocked", "recursive"]


def described_tiles(condition="algorithm == 'blocked'", **more):
    """A space in which `block` has a condition, and with `more` parameters."""
    return described(
        "block * unroll <= 64",
        algorithm=ALGORITHMS,
        block=BLOCK | {"condition": condition},
        pad=parameter(bool, condition="block >= 16"),
        unroll=range(1, 5),
        **more,
    )


TILES = described_tiles()


@pytest.fixture
def tiles():
    return Space.from_dict(TILES)


def by_hand(space):
    """The distinct allowed configurations, from the text of TILES."""
    allowed = set()
    for algorithm, block, pad, unroll in itertools.product(*(item.values for item in space.parameters)):
        block = block if algorithm == "blocked" else None
        pad = pad if block is not None and block >= 16 else None
        if block is None or block * unroll <= 64:
            allowed.add((algorithm, block, pad, unroll))
    return allowed


def test_configurations_that_differ_in_inactive_parameters_only_are_one_point(tiles):
    plain = {"algorithm": "plain", "unroll": 2}
    values = ({}, {"block": None, "pad": None}, {"block": 32, "pad": True}, {"block": 8})
    same = [plain | inactive for inactive in values]
    assert len({tiles.encode(configuration) for configuration in same}) == 1
    # A parameter is inactive as well while one that its condition mentions is inactive.
    assert tiles.decode(tiles.encode(plain)) == plain | {"block": None, "pad": None}
    blocked = {"algorithm": "blocked", "block": 8, "unroll": 2}
    assert tiles.decode(tiles.encode(blocked | {"pad": True}))["pad"] is None
    assert tiles.encode(blocked | {"block": 16, "pad": True}) != tiles.encode(
        blocked | {"block": 16, "pad": False}
    )


def test_of_alternatives_one_whose_parameters_are_active_is_enough():
    prefetch = parameter(bool, condition="block == 8 or unroll > 2 or algorithm == 'plain'")
    space = Space.from_dict(described_tiles(prefetch=prefetch))
    for point, active in (
        ({"algorithm": "plain", "unroll": 1}, True),
        ({"algorithm": "recursive", "unroll": 3}, True),
        ({"algorithm": "recursive", "unroll": 1}, False),
        ({"algorithm": "blocked", "block": 8, "unroll": 1}, True),
        ({"algorithm": "blocked", "block": 16, "pad": True, "unroll": 1}, False),
    ):
        index = space.encode(point | {"prefetch": True})
        assert space.decode(index)["prefetch"] == (True if active else None)


def test_a_value_is_missing_only_where_its_parameter_is_active(tiles):
    for left_out in ({}, {"block": None}):
        with pytest.raises(ConfigurationError, match="'block' is missing"):
            tiles.encode({"algorithm": "blocked", "unroll": 1, "pad": False, **left_out})
    with pytest.raises(ConfigurationError, match="'pad' is missing"):
        tiles.encode({"algorithm": "blocked", "unroll": 1, "block": 32})
    with pytest.raises(ConfigurationError, match="block"):
        tiles.encode({"algorithm": "plain", "unroll": 1, "block": 9})
    with pytest.raises(ConfigurationError, match="unroll"):
        tiles.encode({"algorithm": "plain", "unroll": None})


def test_a_constraint_does_not_apply_to_inactive_parameters(tiles):
    assert tiles.encode({"algorithm": "plain", "block": 32, "unroll": 4}) >= 0
    with pytest.raises(ForbiddenError, match="block = 32, unroll = 4 breaks"):
        tiles.encode({"algorithm": "blocked", "block": 32, "pad": False, "unroll": 4})


def test_counting_drawing_and_the_grid_agree_with_a_list_by_hand(tiles):
    expected = by_hand(tiles)
    grid = np.flatnonzero(tiles.allowed_grid)
    assert {tuple(tiles.decode(int(index)).values()) for index in grid} == expected
    assert len(grid) == len(expected) == tiles.count_allowed().points
    assert tiles.count_allowed().exact
    assert tiles.allowed(range(len(tiles))).tolist() == tiles.allowed_grid.tolist()
    assert (tiles.fold(np.arange(len(tiles)))[grid] == grid).all()
    drawn = sample(tiles, 1000, np.random.default_rng(0))
    assert sorted(drawn.tolist()) == grid.tolist()
    for index in grid.tolist():
        assert tiles.encode(tiles.decode(index)) == index


def test_an_initial_design_tries_each_choice_as_often():
    space = space_of(
        algorithm=ALGORITHMS,
        size=parameter(range(1, 1001), condition="algorithm == 'blocked'"),
        depth=parameter(range(1, 21), condition="algorithm == 'recursive'"),
    )
    design = [space.decode(int(i)) for i in spread_sample(space, 30, np.random.default_rng(1))]
    assert sum(point["algorithm"] == "recursive" for point in design) >= 8  # uniformly, it would be 0 or 1
    assert sum(point["algorithm"] == "plain" for point in design) == 1
    assert len({tuple(point.values()) for point in design}) == 30


def test_neighbours_change_one_parameter_and_what_that_activates_has_its_default(tiles):
    plain = tiles.encode({"algorithm": "plain", "unroll": 2})
    neighbours = [tiles.decode(int(index)) for index in tiles.neighbours(plain, reach=1)]
    assert {tuple(point.values()) for point in neighbours} == {
        ("plain", None, None, 1),
        ("plain", None, None, 3),
        ("recursive", None, None, 2),
        ("blocked", 16, False, 2),
    }
    blocked = tiles.encode({"algorithm": "blocked", "block": 32, "pad": True, "unroll": 1})
    neighbours = [tiles.decode(int(index)) for index in tiles.neighbours(blocked)]
    assert len(neighbours) == len({tuple(point.values()) for point in neighbours})
    assert {"algorithm": "plain", "block": None, "pad": None, "unroll": 1} in neighbours


def test_models_do_not_see_inactive_parameters(tiles):
    strides = dict(zip(tiles.names, tiles.strides, strict=True))
    plain = tiles.encode({"algorithm": "plain", "unroll": 2})
    others = [plain + strides["block"], plain - strides["block"], plain + strides["pad"]]
    features = tiles.features([plain, *others])
    assert (features == features[0]).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_search_asks_for_two_points_again_at_most(tiles, method):
    options = {} if method == "random" else {"initial": 6}
    explorer = Explorer(tiles, ["seconds"], method=method, seed=2, **options)
    seconds = lambda point: {"seconds": 1.0 + point["unroll"] + (point["block"] or 100)}  # noqa: E731
    asked = spend(explorer, 30, measure=seconds)
    assert repeats_in(asked, tiles) <= 2 * (method == "bayesian")
    assert all((point["block"] is None) == (point["algorithm"] != "blocked") for point in asked)
    state = json.loads(json.dumps(explorer.state()))
    assert Explorer.restore(tiles, state).ask(4) == explorer.ask(4)


def test_files_have_an_empty_cell_and_json_null_for_what_is_inactive(toy):
    (toy / "space.json").write_text(json.dumps(TILES))
    columns = ["algorithm", "block", "pad", "unroll", "error", "seconds"]
    with (toy / "table.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for point in sorted(by_hand(Space.from_dict(TILES)), key=str):
            writer.writerow(["" if value is None else value for value in point] + [point[3], 1])
    assert explore(toy, "--budget", "40") == 0
    space = Space.load(toy / "out" / "space.json")
    written = rows(toy / "out" / "evaluations.csv")
    assert len(written) == len(by_hand(space))
    assert {row["failure"] for row in written} == {""}
    assert {row["block"] for row in written if row["algorithm"] == "plain"} == {""}
    explorer = Folder(toy / "out").read(space)
    assert len(explorer.history.results) == len(written)
    objectives = read_objectives(["error", "seconds"])
    read = read_measurements(toy / "out" / "evaluations.csv", space, objectives)
    assert {tuple(point.values()) for point, _ in read} == by_hand(space)
    table = from_table(toy / "table.csv", space, objectives)
    assert table({"algorithm": "plain", "unroll": 3, "block": 8}) == {"error": 3.0, "seconds": 1.0}


def test_pictures_show_what_is_inactive_as_an_empty_cell(tiles):
    explorer = Explorer(tiles, ["seconds", "error"], method="random")
    batch = explorer.ask(30)
    explorer.tell(batch, [{"seconds": 5.0 - point["unroll"], "error": point["unroll"]} for point in batch])
    drawn = page(explorer, {})
    table = drawn[drawn.index("<tbody>") : drawn.index("</tbody>")]
    assert "<td></td><td></td>" in table
    assert "None" not in table
    assert "<dt>hypervolume of logarithms</dt>" in drawn
    assert "<dt>up to</dt><dd>seconds 4, error 4</dd>" in drawn


def test_the_default_shows_what_is_active_and_survives_json(tiles):
    assert tiles.default == {"algorithm": "plain", "block": None, "pad": None, "unroll": 1}
    again = Space.from_dict(json.loads(json.dumps(tiles.to_dict())))
    assert again == tiles
    assert again.digest == tiles.digest
    without = Space.from_dict(
        TILES
        | {"parameters": [{k: v for k, v in p.items() if k != "condition"} for p in TILES["parameters"]]}
    )
    assert without.digest != tiles.digest


def test_a_default_that_moves_takes_what_is_inactive_with_it():
    size = parameter([1, 2, 3], condition="mode == 'b'")
    space = space_of("mode == 'b'", "size > 1", mode=["a", "b"], size=size)
    assert space.default == {"mode": "b", "size": 2}
    assert space.count_allowed().points == 2
    assert Space.from_dict(space.to_dict()).encode(space.default) == space.encode(space.default)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        *((condition, "condition") for condition in (3, None, ["a"])),
        ("algoritm == 'blocked'", "condition of 'block'.*did you mean 'algorithm'"),
        ("algorithm == 'block'", "'algorithm' is never 'block'"),
        ("block > 8", "depends on 'block' itself"),
        ("pad", r"block -> pad -> block"),
        ("unroll", "'unroll' is a number, not a condition"),
        ("", "condition of 'block'"),
        ("__import__('os')", "not understood"),
    ],
)
def test_a_condition_that_cannot_be_read_is_named(condition, message):
    with pytest.raises(ConstraintError if isinstance(condition, str) else SpaceError, match=message):
        Space.from_dict(described_tiles(condition))


def nested(levels, values):
    """Switches of which each opens the next, with as many values of a parameter below each."""
    parameters = {"s0": bool}
    for level in range(levels):
        parameters[f"s{level + 1}"] = parameter(bool, condition=f"s{level}")
        parameters[f"v{level}"] = parameter(range(1, values + 1), condition=f"s{level}")
    return space_of(**parameters)


def test_what_conditions_link_too_much_to_be_tabulated_is_estimated_and_drawn_all_the_same(monkeypatch):
    monkeypatch.setattr(region, "LARGEST_JOIN", 64)
    space = nested(3, 10)
    assert space.region.folded
    # s0 false: 1; each further level has 10 times as many.
    exact = 1 + 10 * (1 + 10 * (1 + 10 * 2))
    count = space.count_allowed()
    assert not count.exact
    assert abs(count.points - exact) <= 4 * count.error
    drawn = sample(space, 300, np.random.default_rng(0))
    assert len(set(drawn.tolist())) == 300
    assert space.allowed(drawn).all()
    every = sample(space, 10_000, np.random.default_rng(0))
    assert len(every) == exact
    monkeypatch.undo()
    assert nested(3, 10).count_allowed() == region.Count(exact)


@st.composite
def conditional_spaces(draw):
    parameters = {}
    for number in range(draw(st.integers(2, 4))):
        values = list(range(draw(st.integers(1, 3))))
        fields = parameter(values, default=draw(st.sampled_from(values)))
        if number and draw(st.booleans()):
            fields["condition"] = f"p{draw(st.integers(0, number - 1))} >= {draw(st.integers(0, 2))}"
        parameters[f"p{number}"] = fields
    return space_of(**dict(draw(st.permutations([*parameters.items()]))))


@settings(deadline=None, max_examples=60)
@given(conditional_spaces())
def test_any_space_folds_each_index_to_the_one_that_is_allowed(space):
    every = np.arange(len(space))
    folded = space.fold(every)
    assert (space.fold(folded) == folded).all()
    assert sorted(set(folded.tolist())) == np.flatnonzero(space.allowed_grid).tolist()
    assert space.count_allowed().points == len(set(folded.tolist()))
    configurations = [space.decode(index) for index in every.tolist()]
    for index, configuration in enumerate(configurations):
        assert space.encode(configuration) == folded[index]
    distinct = {tuple(configuration.values()) for configuration in configurations}
    assert len(distinct) == len(set(folded.tolist()))
    assert space.allowed(space.encode(space.default) + np.zeros(1, dtype=int)).all()
    counts = np.bincount(folded, minlength=len(space))[folded]
    assert space.multiplicity(every).tolist() == counts.tolist()
