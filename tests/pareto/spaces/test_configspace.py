"""ConfigSpace's files and HyperMapper's: the same configurations before and after."""

import json

import numpy as np
import pytest

from pareto import Explorer, Objective, Scenario, Space
from pareto.cli.commands import main
from pareto.errors import ParetoError, ScenarioError
from pareto.spaces.configspace import is_configspace, read_configspace, write_configspace
from pareto.spaces.hypermapper import write_hypermapper
from tests.builders.spaces import parameter, space_of
from tests.pareto.conftest import rows

LOGARITHMIC = {"lower": 0.1, "upper": 10.0, "log": True}
# As ConfigSpace 1.2 writes it.
FILE = {
    "name": "kernel",
    "hyperparameters": [
        {"type": "categorical", "name": "algorithm", "choices": ["plain", "blocked"], "weights": None},
        {"type": "categorical", "name": "flag", "choices": [True, False], "default_value": False},
        {"type": "constant", "name": "n", "value": 5, "meta": None},
        {"type": "ordinal", "name": "block", "sequence": [8, 16, 32], "default_value": 16, "meta": None},
        {"type": "uniform_int", "name": "unroll", "lower": 1, "upper": 4, "default_value": 2, "log": True},
        {"type": "uniform_float", "name": "thr eshold", "default_value": 1.1, **LOGARITHMIC},
    ],
    "conditions": [
        {"type": "EQ", "child": "block", "parent": "algorithm", "value": "blocked"},
        {
            "type": "AND",
            "child": "unroll",
            "conditions": [
                {"type": "IN", "child": "unroll", "parent": "block", "values": [16, 32]},
                {"type": "NEQ", "child": "unroll", "parent": "algorithm", "value": "plain"},
            ],
        },
        {
            "type": "OR",
            "child": "thr eshold",
            "conditions": [
                {"type": "GT", "child": "thr eshold", "parent": "unroll", "value": 2},
                {"type": "EQ", "child": "thr eshold", "parent": "algorithm", "value": "plain"},
            ],
        },
    ],
    "forbiddens": [
        {
            "type": "AND",
            "clauses": [
                {"type": "EQUALS", "name": "algorithm", "value": "blocked"},
                {"type": "IN", "name": "flag", "values": [True]},
            ],
        },
        {"type": "RELATION_LT", "left": "n", "right": "unroll"},
        {"type": "CLAUSE_GE", "name": "thr eshold", "value": 9.0},
    ],
    "python_module_version": "1.2.0",
    "format_version": 0.4,
}
# As ConfigSpace 0.4 to 0.7 writes it.
OLDER = {
    "hyperparameters": [
        {
            "name": "a",
            "type": "categorical",
            "choices": ["x", "y"],
            "default": "y",
            "probabilities": [0.9, 0.1],
        },
        {"name": "b", "type": "uniform_int", "log": False, "lower": 0, "upper": 10, "default": 4, "q": 2},
        {"name": "c", "type": "unparametrized", "value": "fixed"},
        {"name": "d", "type": "normal_float", "log": False, "mu": 0, "sigma": 1, "lower": -1, "upper": 1},
    ],
    "conditions": [{"child": "b", "parent": "a", "type": "EQ", "value": "y"}],
    "forbiddens": [{"left": "b", "right": "d", "type": "RELATION", "lambda": "LESS"}],
    "python_module_version": "0.6.0",
    "json_format_version": 0.4,
}


def configurations(space):
    """All allowed configurations, without what is inactive."""
    return {
        frozenset((name, value) for name, value in space.decode(int(index)).items() if value is not None)
        for index in np.flatnonzero(space.allowed_grid)
    }


def test_a_configspace_gives_parameters_conditions_and_constraints():
    scenario = read_configspace(FILE, real_count=5)
    space = scenario.space
    assert list(space.default.values()) == ["plain", False, 5, None, None, 1.0]
    # plain: 2 flags with 4 thresholds below 9; blocked without flag: block 8, 2 * 2 unrolls up to 2 without
    # a threshold, 2 * 2 above 2 with 4 thresholds each.
    assert space.count_allowed().points == 2 * 4 + 1 + 2 * 2 + 2 * 2 * 4
    assert scenario.objectives == ()
    assert scenario.notes == (
        "thr eshold takes 5 values",
        "thr eshold: its default 1.1 becomes the nearest value, 1",
    )


def test_the_note_has_the_number_of_values_that_a_rounded_scale_has():
    depth = {"name": "depth", "type": "uniform_int", "lower": 1, "upper": 100, "log": True}
    scenario = read_configspace({"hyperparameters": [depth]})
    [parameter] = scenario.space.parameters
    assert len(parameter.values) < 33
    assert scenario.notes == (f"depth takes {len(parameter.values)} values",)


def test_files_of_older_versions_are_read():
    scenario = read_configspace(OLDER, real_count=3)
    assert [len(item.values) for item in scenario.space.parameters] == [2, 6, 1, 3]
    assert scenario.space.default == {"a": "y", "b": 4, "c": "fixed", "d": -1.0}
    assert scenario.space.constraints[0].text == "not (b < d)"
    assert "a: its weights have no effect" in scenario.notes
    assert "d: its normal distribution has no effect: only its bounds count" in scenario.notes


def test_what_is_written_describes_the_same_configurations():
    space = read_configspace(FILE, real_count=5).space
    written = json.loads(json.dumps(write_configspace(space)))
    assert is_configspace(written)
    again = read_configspace(written).space
    assert configurations(again) == configurations(space)
    assert again.default == space.default


TILES = space_of(
    "block * unroll <= 64",
    "scale < 1 or unroll < 3",
    order={"type": "ordinal", "values": ["ijk", "ikj"]},
    block=parameter([8, 16, 32], condition="order != 'ijk'"),
    unroll=parameter(range(1, 7), default=2),
    pad=parameter(bool, condition="unroll > 1 and unroll < 5 and block >= 16"),
    scale={"type": "real", "values": [0.5, 1.5]},
    vendor=["x", 1, "y"],
)


def test_arithmetic_becomes_lists_of_forbidden_values():
    written = json.loads(json.dumps(write_configspace(TILES)))
    again = read_configspace(written).space
    assert configurations(again) == configurations(TILES)
    assert not any("*" in constraint.text for constraint in again.constraints)


@pytest.mark.parametrize("space", [TILES, read_configspace(FILE, real_count=5).space], ids=["tiles", "file"])
def test_configspace_reads_what_is_written(space):
    ConfigSpace = pytest.importorskip("ConfigSpace")
    theirs = ConfigSpace.ConfigurationSpace.from_serialized_dict(write_configspace(space))
    drawn = {frozenset(dict(point).items()) for point in theirs.sample_configuration(2000)}
    assert drawn <= configurations(space)
    assert len(drawn) > 0.9 * len(configurations(space))


OUTSIDE = {"type": "uniform_int", "name": "a", "lower": 1, "upper": 2, "default": 9}
EQUAL = {"type": "EQ", "child": "n", "parent": "flag", "value": 5}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hyperparameters": [{"type": "uniform_int", "name": "a"}]}, "has no bounds"),
        ({"hyperparameters": [{"type": "tree", "name": "a"}]}, "type 'tree' is not known"),
        ({"hyperparameters": [{"name": "a"}]}, "not a ConfigSpace file: KeyError 'type'"),
        ({"hyperparameters": ["a"]}, "not a ConfigSpace file"),
        ({"hyperparameters": [OUTSIDE]}, "9"),
        ({"conditions": [EQUAL | {"child": "z", "parent": "n"}]}, "'z', which is not"),
        ({"conditions": [EQUAL | {"type": "LIKE"}]}, "'LIKE' is not known"),
        ({"conditions": [EQUAL | {"parent": "zz"}]}, "unknown parameter 'zz'"),
        ({"forbiddens": [{"type": "RELATION", "left": "n", "right": "n", "lambda": "CALL"}]}, "'CALL'"),
    ],
)
def test_a_configspace_that_cannot_be_read_says_why(change, message):
    with pytest.raises(ParetoError, match=message):
        read_configspace({**FILE, "conditions": [], "forbiddens": [], **change})


@pytest.mark.parametrize(
    ("condition", "constraints", "message"),
    [
        ({"condition": "a and (b == 1 or a)"}, [], "ConfigSpace cannot express"),
        ({"condition": "b > 5000"}, [], "never holds"),
        ({}, ["b + c < 3000"], "at most 1,000"),
    ],
)
def test_what_configspace_cannot_express_is_refused(condition, constraints, message):
    c = parameter(range(1, 1501), **condition)
    with pytest.raises(ScenarioError, match=message):
        write_configspace(space_of(*constraints, a=bool, b=range(1, 1501), c=c))


def test_a_hypermapper_scenario_has_the_same_values_and_says_what_it_lacks():
    written, notes = write_hypermapper(TILES, [Objective("error"), Objective("speed", maximise=True)])
    read = Scenario.from_dict(json.loads(json.dumps(written)))
    assert [objective.name for objective in read.objectives] == ["error", "speed"]
    assert read.space.shape == TILES.shape
    types = {item.name: item.type for item in read.space.parameters}
    assert [name for name, kind in types.items() if kind == "ordinal"] == ["block", "scale"]
    assert [name for name, kind in types.items() if kind == "categorical"] == ["order", "pad", "vendor"]
    assert types["unroll"] == "integer"
    assert list(read.space.default.values()) == ["ijk", 8, 2, "false", 0.5, "x"]
    text = "\n".join(notes)
    assert "'block * unroll <= 64', 'scale < 1 or unroll < 3' left out" in text
    assert "block, pad are always active" in text
    assert "negate speed" in text
    assert "order became categorical" in text


def test_a_space_is_converted_from_the_command_line(tmp_path, capsys):
    ours, theirs, scenario = (tmp_path / name for name in ("ours.json", "theirs.json", "scenario.json"))
    TILES.save(ours)
    assert main(["space", str(ours), "--to", "configspace", "--output", str(theirs)]) == 0
    assert main(["space", str(theirs)]) == 0
    assert capsys.readouterr().out.startswith("space: 432 points, of which constraints and conditions allow ")
    assert main(["space", str(theirs), "--to", "frontrunner"]) == 0
    again = Space.from_dict(json.loads(capsys.readouterr().out))
    assert configurations(again) == configurations(TILES)
    hypermapper = ["space", str(ours), "--to", "hypermapper", "--output", str(scenario)]
    assert main(hypermapper) == 2
    assert "--objectives is missing" in capsys.readouterr().err
    assert main([*hypermapper, "--objectives", "a,b"]) == 0
    assert "HyperMapper has no constraints" in capsys.readouterr().err
    assert main(["space", str(scenario)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "  objectives: a, b"
    assert main(["space", str(ours), "--output", str(scenario)]) == 2


def test_a_configspace_is_explored_as_any_space(tmp_path):
    (tmp_path / "kernel.json").write_text(json.dumps(FILE))
    command = [
        "explore",
        "--space",
        str(tmp_path / "kernel.json"),
        "--objectives",
        "seconds",
        "--budget",
        "4",
    ]
    (tmp_path / "program.sh").write_text("""echo '{"seconds": '${1:-9}'}'\n""")
    command += ["--command", f"sh {tmp_path}/program.sh {{block}}"]
    assert main([*command, "--levels", "5", "--no-picture", "--out", str(tmp_path / "out")]) == 0
    space = Space.load(tmp_path / "out" / "space.json")
    assert len(Explorer(space, ["seconds"]).ask(3)) == 3
    seconds = {(row["block"], row["seconds"]) for row in rows(tmp_path / "out" / "evaluations.csv")}
    assert ("", "9") in seconds  # an inactive parameter is an empty argument
    assert all(block == "" or float(block) == float(value) for block, value in seconds)
