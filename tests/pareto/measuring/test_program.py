"""Measuring with a program that works, fails, hangs or prints nonsense."""

import os
import select
import sys
from pathlib import Path

import pytest

from pareto.errors import EvaluationError, ScenarioError
from pareto.fronts.censored import Censored
from pareto.fronts.objective import read_objectives
from pareto.measuring.program import Program

OBJECTIVES = read_objectives(["error", "seconds"])
NAMES = ("x", "mode")


def python(code):
    return f'{sys.executable} -c "{code}" {{config}} {{x}}'


def test_a_command_is_given_the_configuration_and_its_last_line_is_read():
    code = "import json, sys; c = json.loads(sys.argv[1]); print(1); "
    code += "print(json.dumps(dict(error=c['x'], seconds=int(sys.argv[2]))))"
    evaluate = Program(python(code), NAMES, OBJECTIVES)
    assert evaluate({"x": 3, "mode": "{x} 'quoted'"}) == {"error": 3.0, "seconds": 3.0}


def test_config_is_the_whole_configuration_even_where_a_parameter_has_that_name():
    code = (
        "import json, sys; c = json.loads(sys.argv[1]); print(json.dumps(dict(error=c['config'], seconds=2)))"
    )
    evaluate = Program(python(code), ["x", "config"], OBJECTIVES)
    assert evaluate({"x": 3, "config": 7}) == {"error": 7.0, "seconds": 2.0}


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("raise SystemExit('out of memory')", "exit code 1: out of memory"),
        ("raise SystemExit(3)", "exit code 3: nothing on its error output"),
        ("import os; os.abort()", "ended by SIGABRT"),
        ("print('done')", "not a JSON object: 'done'"),
        ("pass", "not a JSON object: ''"),
        ("print('[' * 100000)", "not a JSON object"),
        ("import os; os.write(1, bytes([255, 254, 10]))", "not a JSON object"),
        ("print([1, 2])", "its last line is not a JSON object"),
        ("print('{}')", "'error' is missing"),
        (
            "print('{%cerror%c: NaN, %cseconds%c: 1}' % ((34,) * 4))",
            "error = nan is not a finite number: end with an",
        ),
        ("print('{%cerror%c: 1%s}' % (34, 34, '0' * 400))", "too large"),
        ("while True: pass", "no answer after 0.3 s"),
    ],
)
def test_a_command_that_fails_is_a_failed_evaluation_with_its_reason(code, reason):
    with pytest.raises(EvaluationError, match=reason):
        Program(python(code), NAMES, OBJECTIVES, timeout=0.3 if "while" in code else None)({"x": 1})


@pytest.mark.slow
def test_all_that_a_timed_out_command_has_started_ends_with_it(tmp_path):
    script = tmp_path / "parent.sh"
    # The child holds the pipe open: it reads as ended only when no writer is left.
    script.write_text(f"exec 3>{tmp_path / 'pipe'}\n(echo here >&3; sleep 1000) &\nwait\n")
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    with pytest.raises(EvaluationError, match=r"no answer after 3 s"):
        Program(f"sh {script}", NAMES, OBJECTIVES, timeout=3)({"x": 1})
    assert os.read(reader, 5) == b"here\n"
    ended, _, _ = select.select([reader], [], [], 30)
    assert ended
    assert os.read(reader, 1) == b""
    os.close(reader)


def test_a_command_that_leaves_something_running_is_not_waited_for(tmp_path):
    script = tmp_path / "parent.sh"
    script.write_text(f"""(read line < {tmp_path / "pipe"}) &\necho '{{"error": 1, "seconds": 2}}'\n""")
    os.mkfifo(tmp_path / "pipe")
    assert Program(f"sh {script}", NAMES, OBJECTIVES)({"x": 1}) == {"error": 1.0, "seconds": 2.0}
    (tmp_path / "pipe").write_text("end\n")  # blocks unless the child is still there to read it


def test_a_program_may_say_that_a_configuration_does_not_count():
    code = "import sys; print('{%cerror%c: 1, %cseconds%c: 2, %cok%c: ' % ((34,) * 6) + sys.argv[2] + '}')"
    evaluate = Program(python(code), NAMES, OBJECTIVES, feasible=("ok", "True"))
    assert evaluate({"x": "true"}) == {"error": 1.0, "seconds": 2.0}
    for answer in ("false", "null"):
        with pytest.raises(EvaluationError, match="ok is"):
            evaluate({"x": answer})


def test_a_program_that_does_not_exist_is_named_before_anything_is_measured():
    with pytest.raises(ScenarioError, match="no program 'no-such-program'"):
        Program("no-such-program {config}", NAMES, OBJECTIVES)
    for command in ("", "echo 'unclosed"):
        with pytest.raises(ScenarioError, match="--command"):
            Program(command, NAMES, OBJECTIVES)
    with pytest.raises(EvaluationError, match="cannot run no-such-1"):
        Program("no-such-{x}", NAMES, OBJECTIVES)({"x": 1})


REPORTING = """
trap '{when_asked}' TERM
echo 'report error=.1 seconds~2'
echo 'report error=.3 other=7 report'
echo 'report error=.3 other=7'
while :; do sleep 0.05; done
"""


def reporting(tmp_path, monkeypatch, when_asked, grace):
    monkeypatch.chdir(tmp_path)
    Path("report.sh").write_text(REPORTING.replace("{when_asked}", when_asked))
    return Program("sh report.sh", NAMES, OBJECTIVES, grace=grace)


def test_a_program_that_reports_a_value_beyond_a_limit_is_asked_to_end(tmp_path, monkeypatch):
    evaluate = reporting(tmp_path, monkeypatch, "echo ended > ended; exit", grace=60.0)
    values = evaluate({"x": 1}, conditions=[{"error": 0.2}])
    assert values == {"error": 0.3, "seconds": 2.0}
    assert [type(value) for value in values.values()] == [Censored, float]
    assert Path("ended").read_text() == "ended\n"


def test_a_program_that_does_not_end_when_asked_is_killed(tmp_path, monkeypatch):
    evaluate = reporting(tmp_path, monkeypatch, "", grace=0.2)  # it ignores the signal
    assert evaluate({"x": 1}, conditions=[{"error": 0.2, "seconds": 1.0}])["error"] == 0.3


def test_a_program_that_ends_before_all_objectives_are_reported_has_failed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("report.sh").write_text("echo 'report error=.3'\nexec sleep 1000\n")
    with pytest.raises(EvaluationError, match=r"stopped early: error 0.3 \(beyond 0.2\); not all objectives"):
        Program("sh report.sh", NAMES, OBJECTIVES)({"x": 1}, conditions=[{"error": 0.2}])


def test_what_is_not_a_report_ends_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = ["report error=nan", "report error=9 x", "reports error=9", "report error=.1 seconds=9"]
    answer = '{"error": 1, "seconds": 2}'
    Path("report.sh").write_text(
        "".join(f"echo '{line}'\n" for line in [*lines, "sleep"]) + f"sleep 0.3\necho '{answer}'\n"
    )
    conditions = [{"error": 0.2}, {"error": 0.05, "seconds": 10.0}]
    assert Program("sh report.sh", NAMES, OBJECTIVES)({"x": 1}, conditions=conditions)["error"] == 1.0


def test_a_command_runs_where_the_user_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("answer.sh").write_text("""echo '{"error": 5, "seconds": 6}'\n""")
    assert Program("sh answer.sh", NAMES, OBJECTIVES)({"x": 1}) == {"error": 5.0, "seconds": 6.0}
