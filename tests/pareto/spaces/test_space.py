"""Spaces: what they accept, how points are numbered, their neighbours, and drawing from them."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto.errors import ConfigurationError, ForbiddenError, SpaceError
from pareto.spaces.sampling import sample, spread_sample
from pareto.spaces.space import Space
from tests.builders.spaces import described, parameter, space_of

SPACES = Path(__file__).parents[3] / "pareto" / "spaces"

MIXED = space_of(
    size=parameter([64, 128, 256], default=128),
    kernel=["box", "cone", "ball", "none"],
    fast=parameter(bool, default=True),
    threads=parameter(range(1, 10), step=2, default=5),
    mu=parameter((1e-3, 1.0), count=4, scale="log"),
)


@st.composite
def spaces(draw):
    numbers = st.sets(st.integers(-99, 99) | st.floats(-9, 9), min_size=1, max_size=6).map(sorted)
    scalar = st.text(max_size=3) | st.integers(-9, 9) | st.booleans()
    # Two texts that a CSV file would hold alike are refused.
    written = st.lists(scalar, min_size=1, max_size=6, unique_by=lambda v: str(v).strip().lower())
    kinds = [
        st.builds(lambda values: {"type": "ordinal", "values": values}, numbers),
        st.builds(lambda values: {"type": "categorical", "values": values}, written),
        st.just(bool),
        st.builds(range, st.integers(-9, 9), st.integers(10, 21)),
        st.builds(lambda *ends: parameter(ends, count=5), st.floats(-9, 0), st.floats(1, 9)),
    ]
    return space_of(**{f"p{number}": draw(st.one_of(kinds)) for number in range(draw(st.integers(1, 4)))})


@pytest.mark.parametrize(
    ("name", "points", "digest"),
    [
        ("kfusion", 1_800_000, "351dfa26d670fbfd8db8195773fc2eaa2b16b5679b1d678e7cdc8772d7339726"),
        ("elasticfusion", 442_368, "e55a5fed1bd12ac63b00406e753cb6fbc45fd984431499029e7449f903a6c546"),
    ],
)
def test_the_published_spaces_keep_the_papers_size_and_their_digest(name, points, digest):
    space = Space.load(SPACES / f"{name}.json")
    assert len(space) == points
    assert space.digest == digest  # which saved states name
    assert space.decode(space.encode(space.default)) == space.default


def test_the_adaptive_space_is_the_papers_where_nothing_adapts():
    paper, adaptive = (Space.load(SPACES / f"{name}.json") for name in ("kfusion", "kfusion-adaptive"))
    added = set(adaptive.names) - set(paper.names)
    assert {name: adaptive.default[name] for name in paper.names} == paper.default
    assert {name: adaptive.default[name] for name in added} == {
        "skip_limit": 0, "skip_translation": None, "skip_rotation": None, "integrate_translation": 0,
        "integrate_rotation": None, "raycast_after_fusion": 0,
    }  # fmt: skip
    nothing = {"skip_limit": 0, "integrate_translation": 0, "raycast_after_fusion": 0}
    for index in spread_sample(paper, 20, np.random.default_rng(0)):
        adaptive.encode(paper.decode(int(index)) | nothing)


@pytest.mark.parametrize(
    "values",
    [
        {"skip_limit": 2, "skip_translation": 0.05, "skip_rotation": 0.03, "tracking_rate": 2},
        {"integrate_translation": 0.05, "integrate_rotation": 0.05, "integration_rate": 2},
    ],
)
def test_the_adaptive_space_decides_by_motion_or_by_number(values):
    space = Space.load(SPACES / "kfusion-adaptive.json")
    with pytest.raises(ForbiddenError):
        space.encode(space.default | values)
    space.encode(space.default | values | {"tracking_rate": 1, "integration_rate": 1})


def test_the_published_defaults_are_the_references():
    kfusion = Space.load(SPACES / "kfusion.json").default
    assert (kfusion["compute_size_ratio"], kfusion["icp_threshold"], kfusion["mu"]) == (1, 1e-5, 0.1)
    elasticfusion = Space.load(SPACES / "elasticfusion.json").default
    assert (elasticfusion["icp_weight"], elasticfusion["relocalisation"]) == (10, True)


@settings(deadline=None)
@given(spaces(), st.data())
def test_every_index_decodes_to_a_configuration_that_encodes_back(space, data):
    index = data.draw(st.integers(0, len(space) - 1))
    assert space.encode(space.decode(index)) == index
    assert np.ravel_multi_index(tuple(space.codes([index])[0]), space.shape) == index


@settings(deadline=None)
@given(spaces())
def test_a_space_survives_json(space):
    again = Space.from_dict(json.loads(json.dumps(space.to_dict())))
    assert again == space
    assert again.digest == space.digest


def test_all_indices_are_all_configurations_in_grid_order():
    configurations = [MIXED.decode(index) for index in range(len(MIXED))]
    assert len({json.dumps(item) for item in configurations}) == len(MIXED) == 3 * 4 * 2 * 5 * 4
    assert configurations[1]["mu"] == pytest.approx(1e-2)
    grid = np.arange(len(MIXED)).reshape(MIXED.shape)
    assert MIXED.decode(grid[2, 1, 0, 3, 2])["threads"] == 7


def test_values_are_found_by_value_not_by_type_or_last_digit():
    configuration = {"size": 64.0, "kernel": "cone", "fast": 1, "threads": np.int64(3), "mu": 0.1 + 1e-13}
    index = MIXED.encode(configuration)
    assert MIXED.decode(index) == {
        "size": 64,
        "kernel": "cone",
        "fast": True,
        "threads": 3,
        "mu": pytest.approx(0.1),
    }


def test_csv_text_reads_back_as_the_value_it_was_written_from():
    for index in range(len(MIXED)):
        for each, value in zip(MIXED.parameters, MIXED.decode(index).values(), strict=True):
            assert each.parse(str(value)) == value
    assert MIXED.parameters[0].parse(" 64.0 ") == 64
    assert MIXED.parameters[2].parse("true") is True


def test_a_text_that_looks_like_another_value_reads_back_as_itself():
    values = [1, "1.0", "01", " 2", "1e0", True, "x"]
    [read] = space_of(a=values).parameters
    assert [read.parse(str(value)) for value in values] == values
    assert [type(read.parse(str(value))) for value in values] == [*map(type, values)]
    assert [read.position(text) for text in ("1.00", "2", "TRUE", " x ")] == [0, 3, 5, 6]
    for text in ("2.0", "false", ""):
        with pytest.raises(ConfigurationError, match="is not one of"):
            read.parse(text)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 100}, r"'size': 100 is not one of \[64, 128, 256\]"),
        ({"colour": 1}, "unknown parameter 'colour'"),
        ({"fast": "yes"}, "'fast': 'yes'"),
        ({"size": True}, "'size': True"),
        ({"mu": float("nan")}, "'mu': nan"),
    ],
)
def test_a_configuration_outside_the_space_is_named(change, message):
    with pytest.raises(ConfigurationError, match=message):
        MIXED.encode({**MIXED.default, **change})


def test_a_missing_parameter_and_a_wrong_index_are_named():
    with pytest.raises(ConfigurationError, match="'size' is missing"):
        MIXED.encode({"kernel": "box"})
    for index in (-1, len(MIXED)):
        with pytest.raises(ConfigurationError, match=str(index)):
            MIXED.decode(index)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"name": "a", "type": "ordinal", "values": []}, "no values"),
        ({"name": "a", "type": "ordinal", "values": [2, 1]}, "ascending"),
        ({"name": "a", "type": "ordinal", "values": [1, 1]}, "duplicate"),
        ({"name": "a", "type": "categorical", "values": [1, "1"]}, "1 and '1' are written alike"),
        ({"name": "a", "type": "categorical", "values": ["-O3", "-O3 "]}, "'-O3' and '-O3 ' are written"),
        ({"name": "a", "type": "categorical", "values": [True, "true"]}, "True and 'true' are written"),
        ({"name": "a", "type": "ordinal", "values": [1, 2], "default": 3}, "default of"),
        ({"name": "a", "type": "ordinal", "values": [1, None]}, "None"),
        ({"name": "a", "type": "ordinal", "values": "12"}, "must be a list"),
        ({"name": "a", "type": "enum", "values": [1]}, "'enum'"),
        ({"name": "a", "type": "real", "minimum": 0, "maximum": 1, "count": 5, "scale": "log"}, "log"),
        ({"name": "a", "type": "real", "minimum": 0, "maximum": 1, "default": 2}, "0 .. 1"),
        ({"name": "a", "type": "real", "minimum": 1, "maximum": 1}, "minimum < maximum"),
        ({"name": "a", "type": "real", "minimum": 0, "maximum": 1, "scale": "log"}, "log"),
        ({"name": "a", "type": "integer", "minimum": 3, "maximum": 1}, "no whole numbers"),
        ({"name": "a", "type": "ordinal", "values": [1], "deafult": 1}, "'deafult'"),
        ({"name": "", "type": "ordinal", "values": [1]}, "name"),
        ({"name": "a", "type": "ordinal", "values": [1, float("inf")]}, "finite"),
        ({"name": "a", "type": "categorical", "values": ["x", float("nan")]}, "finite"),
        ({"name": "a", "type": "ordinal", "values": [10**400]}, "finite"),
        ({"name": "a", "type": "ordinal", "values": [1], "minimum": 1}, "minimum is for integers and reals"),
        ({"name": "a", "type": "integer", "values": [1], "step": 1}, "give values or step, not both"),
        ({"name": "a", "type": "integer", "values": [1, 1.5]}, "1.5 is not a whole number"),
        ({"name": "a", "type": "boolean", "values": [0, 1]}, "a boolean is true or false"),
        ({"name": "a", "type": "integer", "minimum": 0, "maximum": 10**12}, "1,000,000,000,001 values"),
        ({"name": "a", "type": "integer", "minimum": 0, "maximum": 9, "step": 2, "count": 3}, "not both"),
        ({"name": "a", "type": "integer", "minimum": 0, "maximum": 9, "scale": "log"}, "needs a count"),
        ({"name": "a", "type": "real", "minimum": 0, "maximum": 1, "count": 10**12}, "use a larger step"),
        ({"name": "a", "type": "real", "minimum": 0, "maximum": 1, "step": -0.1}, "step of -0.1"),
        ({"name": "a", "type": "categorical", "values": ["x", "\ud800"]}, "half of a character"),
    ],
)
def test_a_malformed_parameter_is_refused_with_the_reason(fields, message):
    with pytest.raises(SpaceError, match=message):
        Space.from_dict({"parameters": [fields]})


@pytest.mark.parametrize(
    ("fields", "values"),
    [
        (parameter(range(1, 9), step=3), (1, 4, 7)),
        (parameter(range(1, 65), count=7, scale="log"), (1, 2, 4, 8, 16, 32, 64)),
        (parameter(range(1, 5), count=9), (1, 2, 3, 4)),
        (parameter(range(3, 4)), (3,)),
        (parameter((0, 1), step=0.25), (0, 0.25, 0.5, 0.75, 1.0)),
        (parameter((0.5, 1.2), step=0.5), (0.5, 1.0)),
        (parameter((0.01, 1), count=3, scale="log"), (0.01, 0.1, 1.0)),
    ],
)
def test_a_range_is_cut_into_values_by_step_or_count(fields, values):
    [read] = space_of(a=fields).parameters
    assert read.values == pytest.approx(values)
    assert all(isinstance(value, int) for value in read.values) == (fields["type"] == "integer")


def test_steps_are_decimal_so_that_values_are_as_written_and_the_maximum_is_reached():
    [read] = space_of(a=parameter((-0.3, 0.3), step=0.1)).parameters
    assert read.values == (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)


def test_a_misspelt_field_of_a_space_is_refused():
    with pytest.raises(SpaceError, match="unknown field 'constraint' of a space"):
        Space.from_dict(described(a=bool) | {"constraint": ["a"]})


def test_a_file_that_is_no_space_is_refused(tmp_path):
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "list.json").write_text("[]")
    for name in ("bad.json", "list.json", "missing.json"):
        with pytest.raises(SpaceError):
            Space.load(tmp_path / name)


def test_a_space_saves_and_loads(tmp_path):
    MIXED.save(tmp_path / "mixed.json")
    assert Space.load(tmp_path / "mixed.json") == MIXED


def test_neighbours_differ_in_one_parameter_and_reach_bounds_ordered_steps():
    index = MIXED.encode(MIXED.default)
    here = MIXED.decode(index)
    all_others = [MIXED.decode(other) for other in MIXED.neighbours(index)]
    assert all(sum(other[name] != here[name] for name in here) == 1 for other in all_others)
    assert len(all_others) == 2 + 3 + 1 + 4 + 3
    near = [MIXED.decode(other) for other in MIXED.neighbours(index, reach=1)]
    assert len(near) == 2 + 3 + 1 + 2 + 1
    assert {other["threads"] for other in near} == {3, 5, 7}


def test_features_put_neighbouring_values_near_and_categories_apart():
    indices = np.arange(len(MIXED))
    features = MIXED.features(indices)
    assert features.min() >= 0
    assert features.max() <= 1
    assert MIXED.feature_owner.tolist() == [0, 1, 1, 1, 1, 2, 3, 4]
    box, cone = (MIXED.encode({**MIXED.default, "kernel": kernel}) for kernel in ("box", "cone"))
    assert np.linalg.norm(features[box] - features[cone]) == pytest.approx(1.0)


def test_a_sample_is_distinct_uniform_and_avoids_what_is_excluded():
    rng = np.random.default_rng(0)
    counts: Counter[int] = Counter()
    for _ in range(400):
        drawn = sample(MIXED, 100, rng, exclude=range(0, 300))
        assert len(set(drawn.tolist())) == 100
        assert drawn.min() >= 300
        counts.update(drawn.tolist())
    assert len(counts) == 180
    assert max(counts.values()) < 2 * min(counts.values())


def test_a_sample_never_exceeds_what_is_left():
    rng = np.random.default_rng(0)
    assert sorted(sample(MIXED, 10_000, rng).tolist()) == list(range(480))
    assert sorted(sample(MIXED, 10, rng, exclude=range(475)).tolist()) == [475, 476, 477, 478, 479]
    assert sample(MIXED, 0, rng).tolist() == []


def test_a_space_of_a_million_million_points_is_sampled_without_enumerating_it():
    space = space_of(**{f"p{i}": range(1, 101) for i in range(6)})
    assert len(space) == 10**12
    drawn = sample(space, 1000, np.random.default_rng(0))
    assert len(set(drawn.tolist())) == 1000
    assert space.encode(space.decode(int(drawn[0]))) == drawn[0]
    with pytest.raises(SpaceError, match="too many"):
        space_of(**{f"p{i}": range(1, 10**4 + 1) for i in range(6)})


def test_a_spread_sample_uses_every_value_evenly():
    space = Space.load(SPACES / "kfusion.json")
    codes = space.codes(spread_sample(space, 60, np.random.default_rng(1)))
    for axis, size in enumerate(space.shape):
        assert np.ptp(np.bincount(codes[:, axis], minlength=size)) <= 1
