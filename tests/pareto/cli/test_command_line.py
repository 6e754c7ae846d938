"""python -m pareto explore, run the way its user runs it."""

import io
import json
import subprocess
import sys

import pytest

from pareto import Explorer, Space
from pareto.cli.commands import main
from pareto.fronts.hypervolume import hypervolume_growth
from pareto.measuring.progress import FrontSummary, Progress, duration, summarise_front
from tests.pareto.conftest import SCENARIO, SPACE, complaint, explore, explored_rows, interrupt_after, rows


def test_exploring_a_table_writes_evaluations_front_and_state(toy, capsys):
    evaluations = explored_rows(toy, "--budget", "40")
    assert [row["number"] for row in evaluations] == [str(number) for number in range(1, 41)]
    failures = {row["failure"] for row in evaluations if row["x"] in ("7", "20")}
    assert failures == {"error is 'failed' in the table, not a finite number", "not in the table"}
    front = rows(toy / "out" / "front.csv")
    assert [int(row["x"]) for row in front] == [x for x in range(19, 0, -1) if x != 7]
    assert {row["mode"] for row in front} == {"a,b"}
    assert Space.load(toy / "out" / "space.json") == Space.from_dict(SPACE)
    assert not (toy / "out" / "front.html").exists()
    output = capsys.readouterr()
    assert "18 points on the front" in output.out
    last = output.err.splitlines()[-1]
    assert last.startswith("40/40 measured, 4 failed, 18 on the front, 0 s left, hypervolume ")
    assert " of logarithms up to error " in last
    assert output.out.splitlines()[-1] == last[last.index("hypervolume") :]


def test_a_picture_is_drawn_unless_it_is_declined(toy):
    assert explore(toy, "--units", "seconds=s", "--budget", "5", picture=True) == 0
    assert "seconds [s]" in (toy / "out" / "front.html").read_text()


def test_a_second_run_goes_on_where_the_first_ended(toy):
    explore(toy, "--budget", "30", "--batch", "7", out="whole")
    explore(toy, "--budget", "12", "--batch", "7")
    explore(toy, "--budget", "30", "--batch", "7")
    parts, whole = (rows(toy / name / "evaluations.csv") for name in ("out", "whole"))
    assert len(parts) == 30
    assert len({(row["x"], row["mode"]) for row in parts}) == 30
    points = [[(row["x"], row["mode"]) for row in run] for run in (parts, whole)]
    assert points[0][:7] == points[1][:7]


def test_a_method_that_has_nothing_more_to_ask_says_so(toy, capsys):
    assert explore(toy, "--budget", "50") == 0
    assert "stopped after 40 of 50: random has nothing more to propose" in capsys.readouterr().err


def test_when_nothing_succeeds_the_reason_is_printed(toy, capsys):
    false = [sys.executable, "-c", "raise SystemExit('no GPU')"]
    assert explore(toy, "--budget", "3", source=["--command", subprocess.list2cmdline(false)]) == 1
    output = capsys.readouterr()
    assert "frontrunner: all 3 configurations failed: " in output.err
    assert "frontrunner: 3 times the reason was: exit code 1: no GPU" in output.err
    assert "0 points on the front" in output.out


def test_when_nothing_keeps_the_limits_the_best_values_are_printed(toy, capsys):
    assert explore(toy, "--budget", "10", "--limits", "error=0.001,seconds=5") == 0
    errors = capsys.readouterr().err
    assert "measured configurations keeps error <= 0.001 and seconds <= 5; the best of each are" in errors
    assert "the reason was" not in errors


def test_random_measurements_come_first_as_many_as_asked_for(toy):
    options = ["--method", "algorithm1", "--random", "12", "--budget", "16", "--batch", "4"]
    phases = [row["phase"] for row in explored_rows(toy, *options)]
    assert phases[:12] == ["random"] * 12
    assert phases[12:] == ["active"] * 4


def test_a_scenario_brings_objectives_and_budget(toy, capsys):
    budget = {"design_of_experiment": {"number_of_samples": 6}, "optimization_iterations": 3}
    feasible = {"feasible_output": {"name": "note", "true_value": "-"}}
    (toy / "scenario.json").write_text(json.dumps(SCENARIO | budget | feasible))
    command = ["explore", "--space", str(toy / "scenario.json"), "--table", str(toy / "table.csv")]
    assert main([*command, "--method", "algorithm1", "--out", str(toy / "out")]) == 0
    evaluations = rows(toy / "out" / "evaluations.csv")
    assert [row["phase"] for row in evaluations][:7] == ["random"] * 6 + ["active"]
    assert len(evaluations) <= 9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "5", "--seed", "9"], "seed 0, not 9"),
        (["--budget", "5", "--limits", "error=3"], "limits {}, not {'error': 3.0}"),
        (["--budget", "5", "--limits", "error:3"], "name=number"),
        (["--budget", "5", "--limit", "power=3"], "'power'"),
        (["--budget", "5", "--maximise", "power"], "'power'"),
        (["--budget", "0"], "'0' is not a whole number of 1 or more"),
        (["--budget", "5", "--batch", "1.5"], "'1.5' is not a whole number"),
        (["--budget", "5", "--seed", "one"], "--seed: invalid int value: 'one'"),
        (["--budget", "5", "--method", "best"], "invalid choice: 'best'"),
        (["--budget", "5", "--timeout", "3"], "--timeout is for --command"),
        (["--budget", "5", "--timeout", "nan"], "'nan' is not a number of seconds above 0"),
        (["--budget", "5", "--command", "true"], "not allowed with argument --table"),
        (["--budget", "5", "--objectives", "error"], "objectives"),
        (["--budget", "5", "--objectives", "error,error"], "different names"),
        (["--budget", "5", "--space", "/"], "cannot read the space /"),
        (["--budget", "5", "--no-such-option"], "--no-such-option"),
        ([], "--budget is missing"),
    ],
)
def test_a_wrong_argument_is_one_line_and_exit_code_2(toy, capsys, arguments, message):
    explore(toy, "--budget", "2")
    capsys.readouterr()
    assert explore(toy, *arguments) == 2
    error = complaint(capsys)
    assert message in error
    assert error.startswith("frontrunner: ")


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"parameters": 3}', '{"parameters": []}', "[" * 10**5])
def test_a_file_that_is_no_space_is_one_line_and_exit_code_2(toy, capsys, text):
    (toy / "space.json").write_text(text)
    assert explore(toy, "--budget", "2") == 2
    assert complaint(capsys)


def test_a_folder_goes_on_with_what_measured_it_and_nothing_else(toy, capsys):
    assert explore(toy, "--budget", "3") == 0
    measured = (toy / "out" / "evaluations.csv").read_bytes()
    (toy / "moved.csv").write_bytes((toy / "table.csv").read_bytes())
    (toy / "other.csv").write_bytes((toy / "table.csv").read_bytes().replace(b"1.0", b"2.0"))
    for source in (["--table", str(toy / "other.csv")], ["--command", "true {config}"]):
        capsys.readouterr()
        assert explore(toy, "--budget", "5", source=source) == 2
        error = complaint(capsys)
        assert "was measured by" in error
        assert "source.json" in error
    assert (toy / "out" / "evaluations.csv").read_bytes() == measured
    assert len(explored_rows(toy, "--budget", "5", source=["--table", str(toy / "moved.csv")])) == 5
    (toy / "out" / "source.json").write_text("{")
    assert explore(toy, "--budget", "6") == 2
    assert "source.json is damaged" in capsys.readouterr().err


def test_what_measures_may_be_mended_until_something_was_measured(toy, monkeypatch):
    interrupt_after(monkeypatch, 0)
    assert explore(toy, "--budget", "3", source=["--command", "true"]) == 130
    monkeypatch.undo()
    assert explore(toy, "--budget", "3") == 0
    assert "sha256 of the table" in (toy / "out" / "source.json").read_text()


@pytest.mark.parametrize(
    ("objectives", "message"),
    [
        ("x", "objective 'x' has the name of a parameter"),
        ("error,failure", "'failure' is a fixed column of evaluations.csv"),
        ("phase", "'phase' is a fixed column"),
    ],
)
def test_names_that_would_share_a_column_are_refused(toy, capsys, objectives, message):
    program = ["--command", "true {config}"]
    assert explore(toy, "--budget", "3", "--objectives", objectives, source=program) == 2
    assert message in complaint(capsys)
    assert not (toy / "out").exists()


def test_a_folder_that_cannot_be_written_is_named(toy, capsys):
    (toy / "out").write_text("a file")
    assert explore(toy, "--budget", "2") == 2
    assert str(toy / "out") in complaint(capsys)


class Terminal(io.StringIO):
    """A stream that says it is one."""

    def isatty(self) -> bool:
        return True


def test_progress_is_written_over_on_a_terminal_and_kept_short_elsewhere():
    space = Space.from_dict(SPACE)
    for stream, written in (
        (Terminal(), ["\r1/9 m", "\r4/9 m", "\r9/9 m"]),
        (io.StringIO(), ["1/9 m", "9/9 m"]),
    ):
        explorer = Explorer(space, ["error"], method="random")
        now = 100.0
        progress = Progress(explorer, 9, stream, clock=lambda: now)  # noqa: B023
        for number, configuration in enumerate(explorer.ask(9), 1):
            now += 0.04
            explorer.tell([configuration], [{"error": 2.0}])
            progress.update(number)
        progress.end()
        text = stream.getvalue()
        positions = [text.index(start) for start in written]
        assert positions == sorted(positions)
        assert text.endswith("\n")
        assert text.count("\n") == (1 if stream.isatty() else 2)


def test_time_left_is_the_mean_so_far_times_what_is_missing():
    explorer = Explorer(Space.from_dict(SPACE), ["error"], method="random")
    now = 0.0
    stream = io.StringIO()
    progress = Progress(explorer, 20, stream, clock=lambda: now)
    for number, values in enumerate([{"error": 1.0}, None], 1):
        now += 60.0
        explorer.tell(explorer.ask(1), [values])
        progress.update(number)
    assert stream.getvalue().splitlines() == [
        "1/20 measured, 1 on the front, 19:00 min left",
        "2/20 measured, 1 failed, 1 on the front, 18:00 min left",
    ]
    assert [duration(seconds) for seconds in (0.4, 99.4, 100, 5999, 6000, 90_000)] == [
        "0 s",
        "99 s",
        "1:40 min",
        "99:59 min",
        "1:40 h",
        "25:00 h",
    ]


def test_the_volume_that_a_search_prints_never_falls():
    explorer = Explorer(Space.from_dict(SPACE), ["error", "seconds"], method="random", seed=3)
    printed, stream = [], io.StringIO()
    progress = Progress(explorer, 40, stream, clock=lambda: 20.0 * len(printed))
    for number, point in enumerate(explorer.ask(40), 1):
        worse = 100.0 if number > 20 else 1.0
        explorer.tell([point], [{"error": worse / point["x"], "seconds": worse * point["x"]}])
        progress.update(number)
        printed.append(stream.getvalue().splitlines()[-1])
    assert not any("hypervolume" in line for line in printed[:9])
    volumes = [float(line.split("hypervolume ")[1].split()[0]) for line in printed[9:]]
    assert volumes == sorted(volumes)
    assert len({line.split(" up to ")[1] for line in printed[9:]}) == 1


def test_whole_numbers_are_stored_as_the_program_printed_them(toy):
    (toy / "table.csv").write_text("x,mode,error,seconds\n1,c,1820556,.25\n")
    assert explore(toy, "--budget", "40") == 0
    for file in ("evaluations.csv", "front.csv"):
        [row] = [row for row in rows(toy / "out" / file) if row["error"]]
        assert (row["error"], row["seconds"]) == ("1820556", "0.25")


def test_the_reported_volume_is_where_its_curve_ends():
    explorer = Explorer(
        Space.from_dict(SPACE), ["error", "seconds"], {"seconds": 9.0}, method="random", seed=3
    )
    assert summarise_front(explorer, explorer.estimates().expected) == FrontSummary(0, 0.0, {})
    batch = explorer.ask(20)
    results = [{"error": 1 / point["x"], "seconds": float(point["x"])} for point in batch]
    explorer.tell(batch, results)
    growth = hypervolume_growth([[item["error"], item["seconds"]] for item in results], [None, 9.0])
    front = summarise_front(explorer, explorer.estimates().expected)
    assert front.size == len(explorer.front())
    assert front.reference == {"error": 1.0, "seconds": 9.0}
    assert front.volume == pytest.approx(growth[-1])
    assert growth[-1] > 0


def test_a_missing_scipy_is_an_error_with_what_to_install():
    hidden = "import runpy, sys; sys.modules['scipy'] = None; runpy.run_module('pareto', run_name='__main__')"
    ended = subprocess.run([sys.executable, "-c", hidden, "front"], capture_output=True, text=True)
    assert ended.returncode == 2
    assert ended.stderr == "frontrunner: searching needs scipy: pip install 'frontrunner[explore]'\n"


def test_a_warm_start_is_added_once_and_does_not_use_up_the_budget(toy):
    explore(toy, "--budget", "10", out="earlier")
    earlier = rows(toy / "earlier" / "evaluations.csv")
    again = ["--warm-start", str(toy / "earlier" / "evaluations.csv"), "--seed", "5", "--batch", "3"]
    assert explore(toy, "--budget", "4", *again) == 0
    evaluations = explored_rows(toy, "--budget", "6", *again)
    assert [row["phase"] for row in evaluations] == ["told"] * 10 + ["random"] * 6
    points = [(row["x"], row["mode"]) for row in evaluations]
    assert points[:10] == [(row["x"], row["mode"]) for row in earlier]
    assert len(set(points)) == 16
    assert [row["error"] for row in evaluations[:10]] == [row["error"] for row in earlier]


def test_a_warm_start_that_was_cut_off_is_completed(toy, monkeypatch):
    (toy / "known.csv").write_text("x,mode,error,seconds\n1,c,1,1\n2,c,oops,2\n1,c,3,3\n3,c,1,1\n")
    whole = toy / "whole" / "evaluations.csv"
    again = ["--warm-start", str(toy / "known.csv"), "--budget", "2"]
    assert explore(toy, *again, out="whole") == 0
    assert [row["failure"] for row in rows(whole)][:4] == ["", "failed in the earlier run", "", ""]
    interrupt_after(monkeypatch, 2)
    assert explore(toy, *again) == 130
    assert len(rows(toy / "out" / "evaluations.csv")) == 2
    monkeypatch.undo()
    assert explore(toy, *again) == 0
    cut = (toy / "out" / "evaluations.csv").read_text()
    assert [line.split(",")[:6] for line in cut.splitlines()] == [
        line.split(",")[:6] for line in whole.read_text().splitlines()
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,mode,error\n", "no column 'seconds'"),
        ("x,mode,error,seconds\n99,c,1,1\n", "line 2: parameter 'x'"),
    ],
)
def test_a_warm_start_that_does_not_fit_is_one_line_and_exit_code_2(toy, capsys, text, message):
    (toy / "known.csv").write_text(text)
    assert explore(toy, "--budget", "2", "--warm-start", str(toy / "known.csv")) == 2
    assert message in complaint(capsys)


def test_an_interrupt_while_the_packages_are_read_is_no_traceback():
    interrupted = """
import runpy, sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "scipy":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
runpy.run_module("pareto", run_name="__main__")
"""
    ended = subprocess.run([sys.executable, "-c", interrupted, "front"], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (130, "\nfrontrunner: interrupted before it began\n")
