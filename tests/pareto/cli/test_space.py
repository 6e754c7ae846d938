"""python -m pareto space: a look at a file before anything is measured with it."""

import json
import subprocess
import sys

from pareto.cli.commands import main
from tests.pareto.conftest import SPACE


def test_a_space_tells_its_size_parameters_and_constraints(tmp_path, capsys):
    (tmp_path / "space.json").write_text(json.dumps(SPACE | {"constraints": ["x <= 5 or mode == 'c'"]}))
    assert main(["space", str(tmp_path / "space.json")]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "toy: 40 points, of which constraints allow 25",
        "  x     integer      1 .. 20, 20 values  (default 1, chosen)",
        "  mode  categorical  a,b, c  (default a,b, chosen)",
        "  constraint: x <= 5 or mode == 'c'",
    ]


def test_a_scenario_tells_what_has_no_effect(tmp_path, capsys):
    scenario = {
        "optimization_objectives": ["cost"],
        "log_file": "hypermapper.log",
        "input_parameters": {"x": {"parameter_type": "real", "values": [0, 1]}},
    }
    (tmp_path / "scenario.json").write_text(json.dumps(scenario))
    assert main(["space", str(tmp_path / "scenario.json"), "--levels", "5"]) == 0
    output = capsys.readouterr()
    assert output.out.splitlines()[0] == "scenario: 5 points"
    assert output.out.splitlines()[-1] == "  objectives: cost"
    assert "log_file" in output.err


def test_a_reader_who_leaves_is_no_error(tmp_path):
    (tmp_path / "space.json").write_text(json.dumps(SPACE))
    command = [sys.executable, "-m", "pareto", "space", str(tmp_path / "space.json")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        running.stdout.close()
        assert running.stderr.read() == ""
    assert running.returncode == 0
