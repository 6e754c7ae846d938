"""python -m pareto, run the way its user runs it."""

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pareto.commands import main
from pareto.errors import EvaluationError, ScenarioError, StateError
from pareto.evaluation import from_command, from_table
from pareto.folder import Folder
from pareto.objective import read_objectives
from pareto.space import Space

ROOT = Path(__file__).parents[2]
SPACE = {
    "name": "toy",
    "parameters": [
        {"name": "x", "type": "integer", "minimum": 1, "maximum": 20},
        {"name": "mode", "type": "categorical", "values": ["a,b", "c"]},
    ],
}


@pytest.fixture
def toy(tmp_path):
    (tmp_path / "space.json").write_text(json.dumps(SPACE))
    with (tmp_path / "table.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "mode", "error", "seconds", "note"])
        for x in range(1, 20):  # x = 20 is missing
            for mode in ("a,b", "c"):
                error = "failed" if x == 7 else 1 / x + (mode == "c")
                writer.writerow([x, mode, error, x, "-"])
    return tmp_path


def explore(toy, *more, source=None, out="out"):
    source = source or ["--table", str(toy / "table.csv")]
    space = ["--space", str(toy / "space.json"), "--objectives", "error,seconds"]
    return main(["explore", *space, *source, "--method", "random", "--out", str(toy / out), *more])


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_exploring_a_table_writes_evaluations_front_state_and_picture(toy, capsys):
    assert explore(toy, "--budget", "40") == 0
    evaluations = rows(toy / "out" / "evaluations.csv")
    assert [row["number"] for row in evaluations] == [str(number) for number in range(1, 41)]
    failures = {row["failure"] for row in evaluations if row["x"] in ("7", "20")}
    assert failures == {
        "not a number in the table: could not convert string to float: 'failed'",
        "not in the table",
    }
    front = rows(toy / "out" / "front.csv")
    assert [int(row["x"]) for row in front] == [x for x in range(19, 0, -1) if x != 7]
    assert {row["mode"] for row in front} == {"a,b"}
    assert "18 points on the front" in capsys.readouterr().out
    html = (toy / "out" / "front.html").read_text()
    assert "toy: 36 measured, 4 failed, 18 on the front" in html
    assert 'src="http' not in html


def test_a_second_run_goes_on_where_the_first_ended(toy):
    explore(toy, "--budget", "30", "--batch", "7", out="whole")
    explore(toy, "--budget", "12", "--batch", "7")
    explore(toy, "--budget", "30", "--batch", "7")
    parts, whole = (rows(toy / name / "evaluations.csv") for name in ("out", "whole"))
    assert len(parts) == 30
    assert len({(row["x"], row["mode"]) for row in parts}) == 30
    assert parts[:7] == whole[:7]


def test_a_run_killed_between_any_two_writes_is_finished_by_the_next(toy):
    explore(toy, "--budget", "30", "--batch", "10", out="whole")
    explore(toy, "--budget", "20", "--batch", "10")
    out = toy / "out"
    state = json.loads((out / "state.json").read_text())
    lines = (out / "evaluations.csv").read_text().splitlines(keepends=True)
    # As if it had died while it wrote the 15th row: the state is the one saved before that batch began.
    second_batch = state["observations"][10:]
    state["observations"] = state["observations"][:10]
    state["pending"] = [[index, phase] for index, phase, _ in second_batch]
    (out / "state.json").write_text(json.dumps(state))
    (out / "evaluations.csv").write_text("".join(lines[:15]) + lines[15][:5])
    explore(toy, "--budget", "30", "--batch", "10")
    strip = [
        [row[name] for name in ("number", "x", "mode", "phase")] for row in rows(out / "evaluations.csv")
    ]
    whole = [
        [row[name] for name in ("number", "x", "mode", "phase")]
        for row in rows(toy / "whole" / "evaluations.csv")
    ]
    assert strip == whole


def test_an_interrupted_run_keeps_what_it_measured(toy):
    (toy / "program.py").write_text('print(\'{"error": 1, "seconds": 2}\')')
    command = [sys.executable, "-m", "pareto", "explore", "--space", str(toy / "space.json")]
    command += ["--objectives", "error,seconds", "--command", f"{sys.executable} {toy / 'program.py'}"]
    command += ["--method", "random", "--budget", "40", "--out", str(toy / "out")]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as running:
        evaluations = toy / "out" / "evaluations.csv"
        while running.poll() is None and not (evaluations.exists() and len(rows(evaluations)) >= 3):
            os.sched_yield()
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate()
    assert running.returncode == 130
    assert "interrupted" in errors
    resumed = Folder(toy / "out").resume(Space.from_dict(SPACE))
    assert len(resumed.history.told) == len(rows(evaluations)) >= 3


def test_front_and_plot_work_from_the_folder_alone(toy, capsys):
    explore(toy, "--budget", "20")
    for name in ("front.csv", "front.html"):
        (toy / "out" / name).unlink()
    capsys.readouterr()
    for command in ("front", "plot"):
        assert main([command, "--space", str(toy / "space.json"), "--out", str(toy / "out")]) == 0
    assert capsys.readouterr().out == (toy / "out" / "front.csv").read_text()
    assert (toy / "out" / "front.html").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "5", "--seed", "9"], "seed 0, not 9"),
        (["--budget", "5", "--limits", "error:3"], "name=number"),
        (["--budget", "5", "--limits", "power=3"], "'power'"),
        (["--budget", "5", "--maximise", "power"], "'power'"),
        (["--budget", "0"], "1 or more"),
    ],
)
def test_a_wrong_argument_is_one_line_and_exit_code_2(toy, capsys, arguments, message):
    explore(toy, "--budget", "2")
    capsys.readouterr()
    assert explore(toy, *arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_folder_without_or_with_another_exploration_is_named(toy, capsys):
    assert main(["front", "--space", str(toy / "space.json"), "--out", str(toy / "none")]) == 2
    assert "no exploration" in capsys.readouterr().err
    explore(toy, "--budget", "2")
    with pytest.raises(StateError, match="another space"):
        Folder(toy / "out").resume(Space.from_dict({"parameters": SPACE["parameters"][:1]}))
    (toy / "out" / "state.json").write_text("{")
    with pytest.raises(StateError, match="damaged"):
        Folder(toy / "out").resume(Space.from_dict(SPACE))


OBJECTIVES = read_objectives(["error", "seconds"])


def python(code):
    return f'{sys.executable} -c "{code}" {{config}} {{x}}'


def test_a_command_is_given_the_configuration_and_its_last_line_is_read():
    code = "import json, sys; c = json.loads(sys.argv[1]); print(1); "
    code += "print(json.dumps(dict(error=c['x'], seconds=int(sys.argv[2]))))"
    evaluate = from_command(python(code), OBJECTIVES)
    assert evaluate({"x": 3, "mode": "{x} 'quoted'"}) == {"error": 3.0, "seconds": 3.0}


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("raise SystemExit('out of memory')", "exit code 1: out of memory"),
        ("import os; os.abort()", "exit code -6"),
        ("print('done')", "last line"),
        ("print('{}')", "'error' is missing"),
        ("while True: pass", "no answer after 0.3 s"),
    ],
)
def test_a_command_that_fails_is_a_failed_evaluation_with_its_reason(code, reason):
    with pytest.raises(EvaluationError, match=reason):
        from_command(python(code), OBJECTIVES, timeout=0.3 if "while" in code else None)({"x": 1})


def test_a_program_that_does_not_exist_is_named():
    with pytest.raises(EvaluationError, match="no-such-program"):
        from_command("no-such-program", OBJECTIVES)({"x": 1})
    for command in ("", "echo 'unclosed"):
        with pytest.raises(ScenarioError, match="--command"):
            from_command(command, OBJECTIVES)


def test_a_table_that_does_not_fit_the_space_is_refused(toy):
    space = Space.from_dict(SPACE)
    with pytest.raises(ScenarioError, match="no column 'power'"):
        from_table(toy / "table.csv", space, read_objectives(["power"]))
    (toy / "bad.csv").write_text("x,mode,error,seconds\n1,c,1,1\n99,c,1,1\n")
    with pytest.raises(ScenarioError, match="line 3: parameter 'x'"):
        from_table(toy / "bad.csv", space, OBJECTIVES)
    with pytest.raises(ScenarioError, match="cannot read"):
        from_table(toy / "none.csv", space, OBJECTIVES)


def test_the_feasible_column_decides_whether_a_row_counts(toy):
    (toy / "t.csv").write_text("x,mode,error,seconds,Valid\n1,c,1,1,TRUE\n2,c,1,1,false\n")
    evaluate = from_table(toy / "t.csv", Space.from_dict(SPACE), OBJECTIVES, feasible=("Valid", "true"))
    assert evaluate({"x": 1, "mode": "c"}) == {"error": 1.0, "seconds": 1.0}
    with pytest.raises(EvaluationError, match="Valid is false"):
        evaluate({"x": 2, "mode": "c"})
    with pytest.raises(EvaluationError, match="not in the table"):
        evaluate({"x": 3, "mode": "c"})


def test_an_installation_without_the_models_is_told_what_to_install():
    hidden = "import runpy, sys; sys.modules['scipy'] = None; runpy.run_module('pareto', run_name='__main__')"
    ended = subprocess.run([sys.executable, "-c", hidden, "front"], capture_output=True, text=True)
    assert ended.returncode == 2
    assert ended.stderr == "pareto: searching needs scipy: pip install 'frontrunner[explore]'\n"
