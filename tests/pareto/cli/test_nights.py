"""What costs engineers a night: programs that fail, searches that stop, states that are lost."""

import json
import os
import pty
import signal
import sys
from datetime import datetime

import pytest

from pareto import Explorer, Space
from pareto.cli.commands import main
from pareto.errors import DamagedStateError, StateError
from pareto.measuring.folder import Folder
from pareto.measuring.interrupts import interruptible
from pareto.search.answer import parameters_without_effect
from tests.pareto.conftest import SCENARIO, SPACE, complaint, explore, explored_rows, interrupt_after, rows
from tests.pareto.measuring.test_folder import as_from_a_terminal, command, kill_at, order, start


def script(toy, text):
    """A command that runs a shell script with the parameters as arguments."""
    (toy / "program.sh").write_text(text)
    return ["--command", f"sh {toy}/program.sh {{x}} {{mode}}"]


WORKS = """echo '{"error": '$1', "seconds": 2}'"""


def test_the_same_failure_at_the_start_ends_the_search_with_the_reason(toy, capsys):
    source = script(toy, "echo no GPU at 0x7f$1$1, retry $1 >&2; exit 3")
    assert explore(toy, "--budget", "30", source=source) == 1
    assert len(rows(toy / "out" / "evaluations.csv")) == 10
    errors = capsys.readouterr().err
    assert "stopped: the first 10 measurements failed in the same way: exit code 3: no GPU" in errors
    assert "--give-up N" in errors
    assert explore(toy, "--budget", "8", "--give-up", "4", source=source, out="4") == 1
    assert len(rows(toy / "4" / "evaluations.csv")) == 4


def test_failures_that_differ_or_come_later_do_not_end_the_search(toy, capsys):
    assert explore(toy, "--budget", "15", "--give-up", "0", source=script(toy, "exit 3")) == 1
    assert "all 15 configurations failed" in capsys.readouterr().err
    later = f"if [ -e {toy}/once ]; then exit 3; fi; touch {toy}/once; {WORKS}"
    assert len(explored_rows(toy, "--budget", "15", source=script(toy, later), out="later")) == 15
    differing = """for i in $(seq $1); do printf a; done >&2; echo $2 >&2; exit 3"""
    assert explore(toy, "--budget", "15", source=script(toy, differing), out="differing") == 1
    assert len(rows(toy / "differing" / "evaluations.csv")) == 15


def test_a_program_that_says_a_configuration_does_not_count_has_not_failed(toy):
    feasible = {"feasible_output": {"name": "ok", "true_value": "yes"}}
    (toy / "space.json").write_text(json.dumps(SCENARIO | feasible))
    source = script(toy, """echo '{"ok": "no"}'""")
    assert explore(toy, "--budget", "15", source=source) == 1
    assert len(rows(toy / "out" / "evaluations.csv")) == 15


def test_a_search_goes_on_after_equal_failures_in_an_earlier_call(toy):
    source = script(toy, f"if [ -e {toy}/mended ]; then {WORKS}; else exit 3; fi")
    assert explore(toy, "--budget", "15", source=source) == 1
    (toy / "mended").touch()
    assert len(explored_rows(toy, "--budget", "15", source=source)) == 15


@pytest.mark.parametrize("objectives", ["error,seconds", "seconds"])
def test_an_objective_that_never_changes_is_a_warning_and_the_search_goes_on(toy, capsys, objectives):
    assert explore(toy, "--budget", "14", "--objectives", objectives, source=script(toy, WORKS)) == 0
    errors = capsys.readouterr().err
    warning = "warning: seconds was 2 in all 10 configurations measured so far"
    assert errors.count(warning) == 1
    assert "error was" not in errors
    assert len(rows(toy / "out" / "evaluations.csv")) == 14
    assert explore(toy, "--budget", "14", out="table") == 0
    assert "warning" not in capsys.readouterr().err


def test_a_command_without_placeholders_is_warned_of(toy, capsys):
    explore(toy, "--budget", "2", source=["--command", f"sh -c '{WORKS.replace(chr(39), '')}'"])
    assert "--command has no placeholder such as {config}" in capsys.readouterr().err
    explore(toy, "--budget", "2", source=script(toy, WORKS), out="with")
    assert "placeholder" not in capsys.readouterr().err


def test_a_parameter_that_no_placeholder_uses_is_warned_of(toy, capsys):
    (toy / "program.sh").write_text(WORKS)
    explore(toy, "--budget", "2", source=["--command", f"sh {toy}/program.sh {{x}}"])
    assert "warning: --command has no placeholder of mode: the program" in capsys.readouterr().err
    for number, used in enumerate(("{x} {mode}", "3 {config}")):
        explore(toy, "--budget", "2", source=["--command", f"sh {toy}/program.sh {used}"], out=str(number))
        assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("program", "ignored"),
    [
        ("""echo '{"error": '$1', "seconds": 2.5}'""", ["mode"]),
        ("""echo '{"error": '$1', "seconds": '${#2}'}'""", []),
        ("""[ $1 != 9 -o $2 = c ] && echo '{"error": '$1', "seconds": 2.5}'""", []),
        ("""echo '{"error": '${#2}', "seconds": 1}'""", ["x"]),
    ],
)
def test_a_parameter_that_changes_nothing_is_reported(toy, capsys, program, ignored):
    assert explore(toy, "--budget", "40", source=script(toy, program)) == 0
    errors = capsys.readouterr().err
    for name in ("x", "mode"):
        warning = f"warning: {name} changed nothing: 40 runs that differ in it alone have equal objectives"
        assert (warning in errors) == (name in ignored)


def test_few_runs_do_not_show_that_a_parameter_changes_nothing():
    explorer = Explorer(Space.from_dict(SPACE), ["error"], method="random")
    pairs = [{"x": x, "mode": mode} for x in range(1, 5) for mode in ("a,b", "c")]
    explorer.tell(pairs[:-1], [{"error": 1.0 / point["x"]} for point in pairs[:-1]])
    assert parameters_without_effect(explorer.history) == {}
    explorer.tell(pairs[-1:], [{"error": 0.25}])
    assert parameters_without_effect(explorer.history) == {"mode": 8}


def test_defaults_that_nobody_gave_are_printed(toy, capsys):
    explore(toy, "--budget", "2")
    assert "frontrunner: no default given, so chosen: x = 1, mode = 'a,b'\n" in capsys.readouterr().err
    given = json.loads(json.dumps(SPACE))
    given["parameters"][0]["default"] = 5
    (toy / "space.json").write_text(json.dumps(given))
    explore(toy, "--budget", "2", out="given")
    assert "so chosen: mode = 'a,b'\n" in capsys.readouterr().err
    main(["space", str(toy / "space.json")])
    assert [line.split("  (")[1] for line in capsys.readouterr().out.splitlines()[1:3]] == [
        "default 5)",
        "default a,b, chosen)",
    ]


def test_jobs_run_at_the_same_time_and_each_has_a_resource_of_its_own(toy):
    # Each program waits for its partner: one alone would wait until its time is over.
    meeting = f"""
        mkdir {toy}/$SLOT || exit 4
        for i in $(seq 6000); do
            if [ -d {toy}/p ] && [ -d {toy}/q ]; then touch {toy}/$SLOT.met; fi
            if [ -e {toy}/p.met ] && [ -e {toy}/q.met ]; then break; fi
            sleep 0.02
        done
        echo '{{"error": '$1', "seconds": 2, "slot": "'$3'"}}'
        [ "$3" = "$SLOT" ] && [ $i -lt 6000 ]
    """
    (toy / "program.sh").write_text(meeting)
    source = ["--command", f"sh {toy}/program.sh {{x}} {{mode}} {{SLOT}}"]
    assert [
        row["failure"] for row in explored_rows(toy, "--budget", "2", "--resource", "SLOT=p,q", source=source)
    ] == ["", ""]


def test_no_two_programs_hold_one_resource(toy):
    lock = f"mkdir {toy}/lock$3 || exit 9; sleep 0.02; rmdir {toy}/lock$3; {WORKS}"
    (toy / "program.sh").write_text(lock)
    source = ["--command", f"sh {toy}/program.sh {{x}} {{mode}} {{CORE}}"]
    options = ["--budget", "30", "--batch", "7", "--jobs", "3", "--resource", "CORE=0,1,2"]
    measured = explored_rows(toy, *options, "--resource", "GPU=a,a,b", source=source)
    assert [row["number"] for row in measured] == [str(number) for number in range(1, 31)]
    assert {row["failure"] for row in measured} == {""}
    assert len({(row["x"], row["mode"]) for row in measured}) == 30


@pytest.fixture
def an_hour_each(monkeypatch):
    """A clock on which each stored measurement takes an hour; it begins at 23:30."""
    append, start, stored = Folder.append, datetime(2026, 1, 30, 23, 30), []

    def counted(*arguments, **names):
        stored.append(1)
        append(*arguments, **names)

    class Now(datetime):
        @classmethod
        def now(cls):
            return start

    monkeypatch.setattr(Folder, "append", counted)
    monkeypatch.setattr("pareto.cli.arguments.datetime", Now)
    monkeypatch.setattr("time.time", lambda: start.timestamp() + 3600 * len(stored))


@pytest.mark.parametrize(
    ("option", "measured"),
    [(["--hours", "4.5"], 5), (["--until", "07:00"], 8), (["--until", "23:40"], 1), (["--hours", "99"], 20)],
)
def test_a_search_ends_by_itself_when_its_time_is_over(toy, capsys, an_hour_each, option, measured):
    assert len(explored_rows(toy, "--budget", "20", *option)) == measured
    output = capsys.readouterr()
    said = f"the time is over: stopped after {measured} of 20; the same command goes on from here"
    assert (said in output.err) == (measured < 20)
    assert "nothing more to propose" not in output.err
    assert "on the front: " in output.out
    assert (toy / "out" / "front.csv").exists()


def test_a_program_that_runs_when_the_time_is_over_is_let_to_finish(toy, an_hour_each):
    waits = f"""
        if mkdir {toy}/first 2>&-; then :; else
            while [ $(wc -l < {toy}/out/evaluations.csv || echo 0) -lt 2 ]; do sleep 0.02; done
        fi
        {WORKS}
    """
    options = ["--budget", "20", "--jobs", "2", "--hours", "0.5"]
    assert [row["failure"] for row in explored_rows(toy, *options, source=script(toy, waits))] == ["", ""]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--hours", "0"], "'0' is not a number of hours above 0"),
        (["--until", "25:00"], "'25:00' is not a time of day such as 07:00"),
        (["--until", "07:00", "--hours", "1"], "not allowed with"),
        (["--jobs", "3", "--resource", "GPU=0,1"], "--jobs 3 needs 3 items of --resource GPU, which has 2"),
        (["--resource", "x=0,1"], "--resource x has the name of a parameter"),
        (["--resource", "config=0,1"], "--resource config has the name"),
        (["--resource", "GPU"], "write NAME=A,B"),
        (["--resource", "G P=1"], "write NAME=A,B"),
        (["--resource", "G=1", "--resource", "G=2"], "given twice"),
        (["--jobs", "0"], "'0' is not a whole number of 1 or more"),
        (["--give-up", "-1"], "whole number of 0 or more"),
        (["--serve", "70000"], "'70000' is not a port"),
        (["--serve"], "--no-picture"),
    ],
)
def test_options_that_cannot_be_kept_are_refused(toy, capsys, options, message):
    assert explore(toy, "--budget", "3", *options, source=script(toy, WORKS)) == 2
    assert message in complaint(capsys)


@pytest.mark.parametrize(
    "option", [["--jobs", "2"], ["--repeats", "2"], ["--give-up", "3"], ["--resource", "A=1"]]
)
def test_options_of_programs_are_refused_for_a_table(toy, capsys, option):
    assert explore(toy, "--budget", "3", *option) == 2
    assert f"{option[0]} is for --command" in capsys.readouterr().err


def test_repeats_are_kept_as_rows_and_averaged(toy):
    noisy = f"""echo $1 >> {toy}/log; echo '{{"error": '$(wc -l < {toy}/log)', "seconds": '$1'}}'"""
    options = ["--budget", "15", "--batch", "4", "--repeats", "3"]
    measured = explored_rows(toy, *options, source=script(toy, noisy))
    points = [(row["x"], row["mode"]) for row in measured]
    # Round after round, so that what drifts in time touches all of a batch alike.
    assert points[:4] == points[4:8] == points[8:12]
    assert len(set(points)) == 5
    explorer = Folder(toy / "out").read(Space.from_dict(SPACE))
    index = explorer.space.encode({"x": int(points[0][0]), "mode": points[0][1]})
    errors = [float(row["error"]) for row in measured if (row["x"], row["mode"]) == points[0]]
    assert errors == [1.0, 5.0, 9.0]
    indices, values = explorer.history.measured()
    assert values[list(indices).index(index)][0] == 5.0


def test_a_failure_is_not_repeated(toy):
    odd = f"if [ $(($1 % 2)) = 1 ]; then exit 3; fi; {WORKS}"
    assert explore(toy, "--budget", "24", "--batch", "6", "--repeats", "2", source=script(toy, odd)) == 0
    counts = {}
    for row in rows(toy / "out" / "evaluations.csv"):
        counts.setdefault(int(row["x"]) % 2, []).append((row["x"], row["mode"]))
    assert len(counts[1]) == len(set(counts[1])) > 0
    assert len(counts[0]) > len(set(counts[0]))


@pytest.mark.slow
def test_repeats_that_were_cut_off_are_completed_in_the_same_order(toy, monkeypatch):
    options = ["--budget", "24", "--batch", "4", "--repeats", "3"]
    source = script(toy, WORKS)
    assert explore(toy, *options, source=source, out="whole") == 0
    for cut in (2, 6, 11, 12):
        out = f"cut-{cut}"
        interrupt_after(monkeypatch, cut)
        assert explore(toy, *options, source=source, out=out) == 130
        monkeypatch.undo()
        assert explore(toy, *options, source=source, out=out) == 0
        assert order(toy / out) == order(toy / "whole")


@pytest.mark.slow
def test_kill_9_with_several_jobs_costs_no_row_and_measures_nothing_twice(toy):
    source = script(toy, WORKS)
    evaluations = toy / "out" / "evaluations.csv"
    before = b""
    for measured in (4, 14):
        with start(toy, "--budget", "40", "--batch", "6", "--jobs", "3", source=source) as running:
            kill_at(running, toy, measured)
        kept = evaluations.read_bytes()
        assert kept.startswith(before)
        before = kept[: kept.rfind(b"\n") + 1]
    assert explore(toy, "--budget", "40", "--batch", "6", "--jobs", "3", source=source) == 0
    measured = rows(evaluations)
    assert evaluations.read_bytes().startswith(before)
    assert len({(row["x"], row["mode"]) for row in measured}) == len(measured) == 40


# Below, a terminal that closes sends SIGHUP.
HANGUP = pytest.param(signal.SIGHUP, marks=pytest.mark.exhaustive)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, HANGUP])
def test_an_interrupt_ends_all_programs_and_keeps_what_is_finished(toy, number):
    # The first three measurements answer; all later ones hang and hold a pipe open for as long as they live.
    hangs = f"""
        exec 3>{toy}/pipe
        if ! mkdir {toy}/1 2>&- && ! mkdir {toy}/2 2>&- && ! mkdir {toy}/3 2>&-; then
            echo hangs >&3; while :; do sleep 100; done
        fi
        {WORKS}
    """
    os.mkfifo(toy / "pipe")
    reader = os.open(toy / "pipe", os.O_RDWR)
    running = start(toy, "--budget", "40", "--jobs", "2", source=script(toy, hangs))
    with running:
        heard = b""
        while heard.count(b"hangs") < 2:
            heard += os.read(reader, 12)
        only_reading = os.open(toy / "pipe", os.O_RDONLY)
        os.close(reader)
        running.send_signal(number)
        _, errors = running.communicate()
    assert running.returncode == 130
    assert "interrupted after 3 of 40 measurements, all of them saved in" in errors
    assert os.read(only_reading, 1) == b""  # both programs are gone
    os.close(only_reading)
    resumed = Folder(toy / "out").resume(Space.from_dict(SPACE))
    assert len(resumed.history.results) == 3
    assert len(resumed.pending()) == 17


def test_a_closed_terminal_ends_all_programs_and_keeps_what_is_finished(toy):
    os.mkfifo(toy / "pipe")
    reader = os.open(toy / "pipe", os.O_RDWR)
    hangs = f"exec 3>{toy}/pipe; mkdir {toy}/1 2>&- || {{ echo hangs >&3; exec sleep 1000; }}; {WORKS}"
    source = script(toy, hangs)
    process, terminal = pty.fork()
    if process == 0:
        as_from_a_terminal()
        os.execv(sys.executable, command(toy, "--budget", "9", source=source))
    assert os.read(reader, 6) == b"hangs\n"
    only_reading = os.open(toy / "pipe", os.O_RDONLY)
    os.close(reader)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 130
    assert os.read(only_reading, 1) == b""  # the program is gone
    os.close(only_reading)
    assert len(rows(toy / "out" / "evaluations.csv")) == 1
    assert len(rows(toy / "out" / "front.csv")) == 1


def test_a_hangup_that_was_ignored_at_the_start_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            signal.raise_signal(signal.SIGHUP)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        with pytest.raises(KeyboardInterrupt), interruptible():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["", "{", "[]", '{"version": 1}', None, "[" * 100_000, "observations"])
def test_a_lost_state_is_rebuilt_from_the_measurements(toy, capsys, damage):
    explore(toy, "--budget", "12", "--batch", "4")
    state, out = toy / "out" / "state.json", toy / "out"
    before = order(out)
    if damage is None:
        state.unlink()
    elif damage == "observations":
        state.write_text(
            json.dumps(json.loads(state.read_text()) | {"observations": [[99999, "random", []]]})
        )
    else:
        state.write_text(damage)
    capsys.readouterr()
    with pytest.raises(DamagedStateError, match="the explore command that measured here rebuilds it"):
        Folder(out).read(Space.from_dict(SPACE))
    assert explore(toy, "--budget", "20", "--batch", "4") == 0
    assert "it was rebuilt from the 12 rows of evaluations.csv" in capsys.readouterr().err
    assert order(out)[:12] == before
    measured = rows(out / "evaluations.csv")
    assert len({(row["x"], row["mode"]) for row in measured}) == len(measured) == 20
    assert (out / "state.damaged.json").exists() == (damage is not None)
    assert explore(toy, "--budget", "21") == 0
    assert "rebuilt" not in capsys.readouterr().err


def test_a_state_is_rebuilt_with_its_failures_and_a_half_written_row_is_cut(toy):
    explore(toy, "--budget", "20", "--seed", "1")
    state, evaluations = toy / "out" / "state.json", toy / "out" / "evaluations.csv"
    before = Folder(toy / "out").read(Space.from_dict(SPACE))
    state.unlink()
    with evaluations.open("a") as file:
        file.write("21,random,1")
    fresh = Explorer(Space.from_dict(SPACE), ["error", "seconds"], method="random", seed=1)
    folder = Folder(toy / "out")
    rebuilt = folder.rebuild(fresh, "lost")
    assert rebuilt.history.results == before.history.results
    assert rebuilt.history.phases == before.history.phases
    assert rebuilt.front() == before.front()
    assert evaluations.read_bytes().endswith(b"\n")
    assert folder.read(Space.from_dict(SPACE)).history.results == before.history.results


def test_a_state_is_not_rebuilt_from_other_columns(toy, capsys):
    explore(toy, "--budget", "5")
    (toy / "out" / "state.json").write_text("{")
    assert explore(toy, "--budget", "9", "--objectives", "seconds,error") == 2
    assert "give the space and objectives that were measured here" in capsys.readouterr().err
    assert (toy / "out" / "state.json").read_text() == "{"
    with pytest.raises(StateError, match="columns"):
        Folder(toy / "out").rebuild(Explorer(Space.from_dict(SPACE), ["error"]), "lost")


@pytest.mark.parametrize("error", [RuntimeError, MemoryError])
def test_an_error_of_our_own_in_a_measurement_is_not_taken_for_a_failure(toy, monkeypatch, error):
    def broken(*_):
        raise error("a bug")

    monkeypatch.setattr("pareto.measuring.program.Program.__call__", broken)
    with pytest.raises(error, match="a bug"):
        explore(toy, "--budget", "3", source=["--command", f"{sys.executable} {{config}}"])
    assert not (toy / "out" / "evaluations.csv").exists()
