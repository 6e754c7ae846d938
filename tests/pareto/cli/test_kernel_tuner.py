"""Kernel Tuner's T1, T4 and cache files as spaces, tables and earlier measurements."""

import json

import pytest

from pareto.cli.commands import main
from pareto.errors import ScenarioError
from pareto.spaces.kernel_tuner import parse, read_space
from tests.pareto.conftest import rows

T1 = {
    "General": {"BenchmarkName": "toy", "OutputFormat": "JSON"},
    "ConfigurationSpace": {
        "TuningParameters": [
            {"Name": "block_size_x", "Type": "int", "Values": "[16*2**i for i in range(3)]", "Default": 32},
            {"Name": "tile", "Type": "int", "Values": "list(range(1, 4))", "Default": 1},
            {"Name": "vector", "Type": "string", "Values": "['float', \"float4\"]", "Default": "float"},
            {"Name": "padding", "Type": "bool", "Values": "[0, 1]"},
        ],
        "Conditions": [{"Expression": "(block_size_x * tile) < 128", "Parameters": ["block_size_x", "tile"]}],
    },
    "KernelSpecification": {"Language": "CUDA", "KernelName": "toy_kernel", "KernelFile": "toy.cu"},
}
TUNED = {"block_size_x": [16, 64, 32], "tile": [1, 2, 3]}


def time_of(block, tile):
    return 100 / block + 3 * tile


def entry(block, tile):
    failed = block * tile == 192
    return {
        "block_size_x": block,
        "tile": tile,
        "time": "CompilationFailedConfig" if failed else time_of(block, tile),
        "times": [] if failed else [time_of(block, tile)],
        "GFLOP/s": 1e20 if (block, tile) == (16, 3) else 1000 / time_of(block, tile),
        "timestamp": "2023-12-22 09:54:05.502007+00:00",
    }


PAIRS = [(block, tile) for block in TUNED["block_size_x"] for tile in TUNED["tile"]]
CACHE = {
    "schema_version": "1.0.0",
    "device_name": "Testing",
    "kernel_name": "toy_kernel",
    "problem_size": [4096, 4096],
    "tune_params_keys": list(TUNED),
    "tune_params": TUNED,
    "objective": "time",
    "cache": {f"{block},{tile}": entry(block, tile) for block, tile in PAIRS},
}
T4 = {
    "schema_version": "1.0.0",
    "results": [
        {
            "configuration": {"block_size_x": block, "tile": tile},
            "times": {"runtimes": []},
            "invalidity": "constraints" if block * tile == 192 else "correct",
            "correctness": int((block, tile) != (16, 1)),
            "measurements": [{"name": "time", "value": time_of(block, tile), "unit": "ms"}],
            "objectives": ["time"],
        }
        for block, tile in PAIRS
    ],
}


def written(folder, name, document):
    path = folder / name
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return str(path)


def explore(folder, space, *more, out="out"):
    search = ["--space", space, "--method", "random", "--budget", "20", "--no-picture"]
    assert main(["explore", *search, "--out", str(folder / out), *more]) == 0
    return rows(folder / out / "evaluations.csv")


def test_a_t1_file_is_a_space_with_its_conditions():
    space = read_space(T1).space
    assert space.name == "toy_kernel"
    assert [list(item.values) for item in space.parameters] == [
        [16, 32, 64],
        [1, 2, 3],
        ["float", "float4"],
        [False, True],
    ]
    assert space.default == {"block_size_x": 32, "tile": 1, "vector": "float", "padding": False}
    assert [constraint.text for constraint in space.constraints] == ["(block_size_x * tile) < 128"]
    assert space.count_allowed().points == 7 * 4


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ("__import__('os').listdir()", "not understood"),
        ("range(10**9)", "more than"),
        ("[2**9999]", "too large"),
        ("[[i for i in range(9)] for j in range(9)]", "not understood"),
        ("16", "not a list"),
        ("['a' * 9]", "not a number"),
        ("[1", "never closed"),
        (None, "not a list"),
    ],
)
def test_values_that_are_more_than_lists_are_never_executed(values, message):
    parameter = {"Name": "x", "Type": "int", "Values": values}
    with pytest.raises(ScenarioError, match=message):
        read_space({"ConfigurationSpace": {"TuningParameters": [parameter]}})


def test_a_cache_is_a_space_with_its_objective_and_a_table(tmp_path, capsys):
    cache = written(tmp_path, "cache.json", CACHE)
    measured = explore(tmp_path, cache, "--table", cache)
    assert "the file's objective time is minimised" in capsys.readouterr().err
    assert {(int(row["block_size_x"]), int(row["tile"])) for row in measured} == set(PAIRS)
    for row in measured:
        block, tile = int(row["block_size_x"]), int(row["tile"])
        assert row["time"] == ("" if block * tile == 192 else repr(time_of(block, tile)).removesuffix(".0"))
    [failure] = [row["failure"] for row in measured if row["failure"]]
    assert failure == "time is 'CompilationFailedConfig' in the table, not a finite number"
    rates = explore(tmp_path, cache, "--table", cache, "--objectives", "GFLOP/s", out="rates")
    assert [row["tile"] for row in rates if row["failure"] and row["block_size_x"] == "16"] == ["3"]


def test_a_cache_that_was_never_closed_is_read(tmp_path):
    whole = json.dumps(CACHE, indent=0)
    assert parse(whole.rstrip().removesuffix("}\n}") + ",\n") == CACHE
    assert parse(whole.rstrip().removesuffix("}\n}")) == CACHE
    cache = written(tmp_path, "cache.json", whole.rstrip().removesuffix("}\n}") + ",")
    assert len(explore(tmp_path, cache, "--table", cache)) == len(PAIRS)


def test_t4_results_start_a_search_and_forbidden_failures_are_left_out(tmp_path, capsys):
    t1 = json.loads(json.dumps(T1))
    del t1["ConfigurationSpace"]["TuningParameters"][2:]
    t1["ConfigurationSpace"]["Conditions"][0]["Expression"] = "block_size_x * tile < 192"
    space, t4 = written(tmp_path, "t1.json", t1), written(tmp_path, "t4.json", T4)
    program = 'python3 -c "print(\'{{\\"time\\": 1}}\')" {config}'
    search = ["--objectives", "time", "--command", program, "--warm-start", t4]
    assert main(["explore", "--space", space, *search, "--budget", "1", "--out", str(tmp_path / "o")]) == 0
    told = rows(tmp_path / "o" / "evaluations.csv")[:8]
    assert [row["phase"] for row in told] == ["told"] * 8
    assert [row["failure"] for row in told] == ["failed in the earlier run"] + [""] * 7
    assert main(["explore", "--space", t4, *search, "--budget", "1", "--out", str(tmp_path / "p")]) == 2
    assert "the space is in the T1 or cache file" in capsys.readouterr().err


def test_json_that_holds_no_measurements_says_what_would(tmp_path, capsys):
    t1 = written(tmp_path, "t1.json", T1)
    broken = written(tmp_path, "broken.json", '{"results": [')
    search = ["explore", "--space", t1, "--objectives", "time", "--budget", "2", "--out", str(tmp_path / "o")]
    assert main([*search, "--table", t1]) == 2
    assert "give a CSV file, or Kernel Tuner's cache or T4 file" in capsys.readouterr().err
    assert main([*search, "--table", broken]) == 2
    assert "neither CSV nor a JSON file of Kernel Tuner" in capsys.readouterr().err
