"""The schema that ships: it accepts what `Space.from_dict` accepts, as far as a schema can tell."""

import json
from pathlib import Path

import jsonschema
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pareto.errors import SpaceError
from pareto.spaces.space import Space

SPACES = Path(__file__).parents[3] / "pareto" / "spaces"
SCHEMA = json.loads((SPACES / "space.schema.json").read_text())
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)

SHIPPED = sorted(path for path in SPACES.glob("*.json") if path.name != "space.schema.json")

GOOD = [
    {"name": "a", "type": "ordinal", "values": [1, 2.5], "default": 2.5},
    {"name": "a", "type": "ordinal", "values": ["low", "high"]},
    {"name": "a", "type": "categorical", "values": ["x", 1, True]},
    {"name": "a", "type": "boolean"},
    {"name": "a", "type": "boolean", "values": [True], "default": True},
    {"name": "a", "type": "integer", "values": [1, 2]},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 9},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 9, "step": 3},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 1024, "count": 11, "scale": "log"},
    {"name": "a", "type": "real", "values": [1, 2.5]},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "step": 0.1},
    {"name": "a", "type": "real", "minimum": 0.1, "maximum": 1, "count": 4, "scale": "linear"},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1},
    {"name": "a", "type": "real", "minimum": 0.1, "maximum": 1, "scale": "log", "default": 0.5},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "prior": {"mean": 0.2, "deviation": 0.1}},
    {"name": "a", "type": "boolean", "prior": [0, 1]},
    {"name": "a", "type": "ordinal", "values": [1, 2.5], "prior": "decay"},
]
BAD = [
    {"type": "boolean"},
    {"name": "a"},
    {"name": 5, "type": "boolean"},
    {"name": "", "type": "boolean"},
    {"name": "a", "type": "enum", "values": [1]},
    {"name": "a", "type": "ordinal"},
    {"name": "a", "type": "ordinal", "values": []},
    {"name": "a", "type": "ordinal", "values": [None]},
    {"name": "a", "type": "ordinal", "values": [[1]]},
    {"name": "a", "type": "ordinal", "values": "12"},
    {"name": "a", "type": "ordinal", "minimum": 1, "maximum": 2},
    {"name": "a", "type": "categorical", "values": ["x"], "step": 1},
    {"name": "a", "type": "boolean", "values": [0, 1]},
    {"name": "a", "type": "boolean", "default": None},
    {"name": "a", "type": "boolean", "count": 2},
    {"name": "a", "type": "integer", "values": [1.5]},
    {"name": "a", "type": "integer", "values": [True]},
    {"name": "a", "type": "integer", "values": [1], "minimum": 1, "maximum": 2},
    {"name": "a", "type": "integer", "minimum": 1},
    {"name": "a", "type": "integer", "minimum": 0.5, "maximum": 3},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 3, "step": 0},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 3, "step": 0.5},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 3, "step": 1, "count": 3},
    {"name": "a", "type": "integer", "minimum": 1, "maximum": 3, "scale": "log"},
    {"name": "a", "type": "real", "values": ["1"]},
    {"name": "a", "type": "real", "minimum": 0},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "prior": {"mean": 0.2}},
    {"name": "a", "type": "boolean", "prior": [0, 0]},
    {"name": "a", "type": "ordinal", "values": [1, 2.5], "prior": "bell"},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "step": 0.1, "scale": "log"},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "scale": "cubic"},
    {"name": "a", "type": "real", "minimum": "0", "maximum": 1, "count": 3},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "count": 1},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "count": 2.5},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "count": 3, "scale": "cubic"},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "step": -1},
    {"name": "a", "type": "real", "minimum": 0, "maximum": 1, "count": 2**20 + 1},
    {"name": "a", "type": "ordinal", "values": [1], "unit": "m"},
]
BAD_SPACES = [
    [],
    {},
    {"parameters": []},
    {"parameters": {}},
    {"parameters": [5]},
    {"parameters": [GOOD[0]], "name": 5},
    {"parameters": [GOOD[0]], "constraint": []},
    {"parameters": [GOOD[0]], "constraints": "a > 1"},
    {"parameters": [GOOD[0]], "constraints": [1]},
    {"parameters": [GOOD[0]], "constraints": [""]},
    {"parameters": [GOOD[0], {"name": "b", "type": "boolean", "condition": ""}]},
    {"parameters": [GOOD[0], {"name": "b", "type": "boolean", "condition": None}]},
    {"parameters": [GOOD[0], {"name": "b", "type": "boolean", "condition": ["a > 1"]}]},
]


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_a_shipped_space_keeps_the_schema(path):
    VALIDATOR.validate(json.loads(path.read_text()))


def test_six_spaces_are_shipped():
    elasticfusion = ["elasticfusion-loops", "elasticfusion-ratio", "elasticfusion"]
    names = [*elasticfusion, "kfusion-adaptive", "kfusion", "systems"]
    assert [path.stem for path in SHIPPED] == names


@pytest.mark.parametrize("parameter", GOOD, ids=json.dumps)
def test_what_is_accepted_keeps_the_schema_before_and_after_a_round_trip(parameter):
    plain = {"$schema": "space.schema.json", "name": "s", "parameters": [parameter], "constraints": []}
    conditional = {"parameters": [{"name": "b", "type": "boolean"}, {**parameter, "condition": "b"}]}
    for description in (plain, conditional):
        VALIDATOR.validate(description)
        VALIDATOR.validate(Space.from_dict(description).to_dict())


@pytest.mark.parametrize(
    "description", [*({"parameters": [item]} for item in BAD), *BAD_SPACES], ids=json.dumps
)
def test_what_breaks_the_schema_is_refused(description):
    assert not VALIDATOR.is_valid(description)
    with pytest.raises(SpaceError):
        Space.from_dict(description)


ANY = st.none() | st.booleans() | st.integers(-3, 3) | st.floats(-3, 3) | st.sampled_from(["", "a", "log"])
FIELD = st.fixed_dictionaries(
    {"name": st.just("a"), "type": st.sampled_from(["ordinal", "categorical", "boolean", "integer", "real"])},
    optional={
        "values": st.lists(ANY, max_size=3) | ANY,
        "default": ANY,
        "minimum": ANY,
        "maximum": ANY,
        "step": ANY,
        "count": ANY,
        "scale": ANY,
    },
)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(FIELD)
@example({"name": "a", "type": "boolean", "values": None})
def test_nothing_that_breaks_the_schema_is_accepted_and_nothing_crashes(parameter):
    description = {"parameters": [parameter]}
    try:
        Space.from_dict(description)
    except SpaceError:
        return
    VALIDATOR.validate(description)
