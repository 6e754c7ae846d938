"""An exploration that is killed, interrupted or cut off at any moment goes on as if nothing had happened."""

import fcntl
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pareto.errors import StateError
from pareto.measuring.folder import LOCK, Folder
from pareto.spaces.space import Space
from tests.pareto.conftest import SPACE, arguments, explore, interrupt_after, rows
from tests.waiting import until

ROOT = Path(__file__).parents[3]


def order(out):
    """What was measured, in which order, and what came back."""
    return [
        [row[name] for name in ("number", "phase", "x", "mode", "error", "seconds")]
        for row in rows(out / "evaluations.csv")
    ]


def command(toy, *more, source=None):
    return [sys.executable, "-m", "pareto", *arguments(toy, *more, source=source)]


def start(toy, *more, source=None):
    how = {"cwd": ROOT, "stderr": subprocess.PIPE, "text": True, "preexec_fn": as_from_a_terminal}
    return subprocess.Popen(command(toy, *more, source=source), **how)


def as_from_a_terminal() -> None:
    """Undo what nohup or a shell's `&` did to the tests: their programs would ignore these signals, too."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def lines(path):
    return path.read_bytes().count(b"\n") if path.exists() else 0


def kill_at(running, toy, measured):
    """kill -9 when so many lines are `measured`, or a little later; return when the folder is free again."""
    evaluations = toy / "out" / "evaluations.csv"
    until(lambda: running.poll() is not None or lines(evaluations) >= measured, pause=0.002)
    running.kill()
    running.wait()
    # A program that was just being started shares the lock until it begins.
    with (toy / "out" / LOCK).open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)


class PowerCutError(BaseException):
    """Nothing in the program expects this, and nothing can be written after it."""


@pytest.mark.slow
def test_a_cut_at_any_write_loses_nothing_and_measures_nothing_twice(toy, monkeypatch):
    explore(toy, "--budget", "12", "--batch", "4", out="whole")
    real = {"fsync": os.fsync, "replace": Path.replace}
    left = 0

    def counted(name):
        def write(*arguments):
            nonlocal left
            left -= 1
            if left < 0:
                raise PowerCutError
            return real[name](*arguments)

        return write

    monkeypatch.setattr("os.fsync", counted("fsync"))
    monkeypatch.setattr(Path, "replace", counted("replace"))
    cuts = 0
    finished = False
    while not finished:
        left, out = cuts, f"cut-{cuts}"
        try:
            explore(toy, "--budget", "12", "--batch", "4", out=out)
            finished = True
        except PowerCutError:
            cuts += 1
        left = 1000
        explore(toy, "--budget", "12", "--batch", "4", out=out)
        assert order(toy / out) == order(toy / "whole")
    assert cuts > 20  # three batches of two writes each for the state, and a write a measurement


@pytest.mark.slow
@pytest.mark.parametrize("torn", [1, 5, 9, None])
def test_a_row_half_written_is_measured_again(toy, torn):
    explore(toy, "--budget", "30", "--batch", "10", out="whole")
    explore(toy, "--budget", "20", "--batch", "10")
    out = toy / "out"
    state = json.loads((out / "state.json").read_text())
    written = (out / "evaluations.csv").read_text().splitlines(keepends=True)
    # As if it had died while it wrote the 15th row: the state is the one saved before that batch began.
    second_batch = state["observations"][10:]
    state["observations"] = state["observations"][:10]
    state["pending"] = [[index, phase] for index, phase, _ in second_batch]
    (out / "state.json").write_text(json.dumps(state))
    (out / "evaluations.csv").write_text("".join(written[:15]) + written[15][: torn or -1])
    explore(toy, "--budget", "30", "--batch", "10")
    assert order(out) == order(toy / "whole")


def test_a_value_with_a_line_break_is_not_taken_for_two_rows(tmp_path):
    values = ["a\nb", "ü\r\nz", "c\nd", "e\rf"]
    space = {"parameters": [{"name": "x", "type": "categorical", "values": values}]}
    (tmp_path / "space.json").write_text(json.dumps(space))
    (tmp_path / "table.csv").write_bytes('x,cost\n"a\nb",1\n"ü\r\nz",2\n"c\nd",3\n"e\rf",4\n'.encode())
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert explore(tmp_path, "--objectives", "cost", "--batch", "1", "--budget", "4", out="whole") == 0
    out.mkdir()
    data = (whole / "evaluations.csv").read_bytes()
    measured = Folder(whole).read(Space.load(tmp_path / "space.json"))
    assert len(measured.front()) == 1
    for cut in range(data.index(b"\n") + 1, len(data)):
        (out / "evaluations.csv").write_bytes(data[:cut])
        state = json.loads((whole / "state.json").read_text())
        pending = [[index, phase] for index, phase, _ in state["observations"]]
        (out / "state.json").write_text(json.dumps(state | {"observations": [], "pending": pending}))
        explorer = Folder(out).resume(Space.load(tmp_path / "space.json"))
        kept = len(explorer.history.results)
        assert data.startswith((out / "evaluations.csv").read_bytes())
        assert len(Folder(out).rows()) == kept
        assert list(explorer.history.results) == [index for index, _ in pending[:kept]]


@pytest.mark.slow
def test_the_default_method_goes_on_as_if_nothing_had_happened(toy, monkeypatch):
    options = ["--method", "bayesian", "--random", "10", "--budget", "22", "--batch", "6"]
    assert explore(toy, *options, out="whole") == 0
    interrupt_after(monkeypatch, 14)
    assert explore(toy, *options) == 130
    monkeypatch.undo()
    assert explore(toy, *options) == 0
    assert order(toy / "out") == order(toy / "whole")
    assert "active" in {row[1] for row in order(toy / "out")}


@pytest.mark.slow
def test_kill_9_at_any_moment_costs_no_measurement(toy):
    explore(toy, "--budget", "36", "--batch", "6", out="whole")
    # The table answers at once, so by the time the kill arrives the run is at some later, random moment.
    for measured in (0, 12):
        with start(toy, "--budget", "36", "--batch", "6") as running:
            until((toy / "out").exists, pause=0.002)
            kill_at(running, toy, measured)
    assert explore(toy, "--budget", "36", "--batch", "6") == 0
    assert order(toy / "out") == order(toy / "whole")


def test_two_processes_do_not_explore_into_one_folder(toy, capsys):
    with Folder(toy / "out").locked():
        assert explore(toy, "--budget", "2") == 2
    assert "another process is exploring in" in capsys.readouterr().err
    assert explore(toy, "--budget", "2") == 0


def test_reading_a_folder_changes_nothing_in_it(toy):
    explore(toy, "--budget", "5")
    with (toy / "out" / "evaluations.csv").open("a") as file:
        file.write("6,random,1")  # another process is just writing
    before = {path.name: path.read_bytes() for path in (toy / "out").iterdir()}
    assert len(Folder(toy / "out").read(Space.from_dict(SPACE)).history.results) == 5
    assert {path.name: path.read_bytes() for path in (toy / "out").iterdir()} == before


def test_a_folder_with_another_or_a_damaged_exploration_is_named(toy):
    explore(toy, "--budget", "4")
    out, space = toy / "out", Space.from_dict(SPACE)
    with pytest.raises(StateError, match="another space"):
        Folder(out).resume(Space.from_dict({"parameters": SPACE["parameters"][:1]}))
    data = (out / "evaluations.csv").read_bytes()
    state = json.loads((out / "state.json").read_text())
    state["observations"] = state["observations"][:1]
    (out / "state.json").write_text(json.dumps(state))
    for damaged, message in [
        (data.replace(b"\n2,", b"\n2,oops\n2,"), "number 2"),
        (data.replace(b"\n2,", b"\n\xff2,"), "damaged after line 2"),
        (data.replace(b"\n2,random,", b"\n2,random,9"), "number 2"),
        (data.splitlines(keepends=True)[0], "rows are lost"),
    ]:
        (out / "evaluations.csv").write_bytes(damaged)
        with pytest.raises(StateError, match=message):
            Folder(out).resume(space)
    (out / "evaluations.csv").write_bytes(data)
    (out / "state.json").write_text("{")
    with pytest.raises(StateError, match="damaged"):
        Folder(out).resume(space)
