"""`run` over a real sequence against a server on a socket, and the commands that follow it."""

import json
import signal
import subprocess
from typing import Any

import pytest

from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.devices.choice import list_devices
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.commands import Terminal, start
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Reply, Request, Serve, always, at_first, problem


@pytest.fixture
def counting(pack: Pack) -> Counting:
    """A server that asks for one run of default and one of best, which is enough for most of what follows."""
    short = {"warmup_frames": 0, "order": ["default", "best"], "repeats": 1}
    protocol = {**manifests.manifest()["protocol"], **short}
    return Counting(room.manifest(pack, protocol=protocol), pack._chunks.folder / "chunks")


def test_a_first_run_asks_measures_sends_and_shows_the_speedup(
    terminal: Terminal, counting: Counting
) -> None:
    counting.manifest["protocol"] = manifests.manifest()["protocol"]

    code, out, error = terminal.run(counting)

    assert code == 0, error
    for shown in (
        "What is sent, with the values of this device",
        '"opencl_device": "',
        "Downloading the sequence room",
        "Speedup of best over default: ",
        "largest trajectory error",
        f"{terminal.server.url}/devices/a-phone/",
    ):
        assert shown in out
    [session] = counting.sessions.values()
    assert [run["configuration"] for run in session["runs"]] == ["default", "best", "best", "default"]
    assert terminal.states() == ["accepted"]


@pytest.mark.slow
def test_a_second_run_asks_for_nothing_again_and_measures_without_a_network(
    terminal: Terminal, counting: Counting, closed_port: int, serve: Serve, watched: room.Watched
) -> None:
    with watched.replayed():
        assert terminal.run(counting, port=closed_port)[0] == 0
    terminal.server.close()

    code, out, error = terminal("run", "--server", terminal.server.url, "--configurations", "all")

    assert code == 0, error
    assert "using its manifest from the last visit" in out
    assert "What is sent" not in out
    assert "indivisible: failed" in out
    assert terminal.states() == ["accepted", "queued"]
    server = serve(counting, closed_port)
    assert terminal("send")[0] == 0
    assert server.paths() == ["POST /api/v1/submissions"]
    assert [len(session["runs"]) for session in counting.sessions.values()] == [2, 3]


@pytest.mark.slow
@pytest.mark.usefixtures("recorded")
def test_a_server_that_goes_away_gets_the_session_with_the_next_command(
    terminal: Terminal, counting: Counting
) -> None:
    code, out, error = terminal.run(always("/enrol", Reply(503, raw=b""), counting))

    assert code == 0, error
    assert f"Not sent: {terminal.server.url}" in out
    assert "stored on this device" in out
    assert "Speedup of best over default: " in out
    assert terminal.states() == ["queued"]

    terminal.server.answer = counting
    code, out, _ = terminal("send")
    assert (code, "accepted" in out, len(counting.sessions)) == (0, True, 1)


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["/manifest", "/sequences/", "/enrol", "/submissions", "/submissions/"])
def test_killed_at_any_request_it_ends_with_every_session_counted_once(
    moment: str, serve: Serve, home: Home, terminal: Terminal, counting: Counting, watched: room.Watched
) -> None:
    process: subprocess.Popen[str]

    def killing(request: Request) -> Reply:
        reply = counting(request)
        path = request.path.removeprefix("/api/v1")
        hit = path.startswith(moment) if moment.endswith("/") else path.split("?")[0] == moment
        if hit and process.poll() is None:
            process.send_signal(signal.SIGKILL)
            process.wait()
        return reply

    scripted = serve(killing)
    process = start(home, "run", "--server", scripted.url, "--yes")
    process.communicate(timeout=120)
    assert process.returncode == -signal.SIGKILL
    measured = len(terminal.states())

    scripted.answer = counting
    with watched.replayed():
        code, _, error = terminal("run", "--server", scripted.url, "--yes")

    assert code == 0, error
    assert terminal.states() == ["accepted"] * (measured + 1)
    assert len(counting.sessions) == measured + 1
    assert len(counting.runs) == len(set(counting.runs)) == 2 * (measured + 1)


def test_a_version_that_is_refused_has_its_own_exit_code(terminal: Terminal, counting: Counting) -> None:
    counting.manifest["minimum_app_version"] = "9.0"

    code, _, error = terminal.run(counting)

    assert (code, terminal.states(), "update it" in error) == (4, [], True)


@pytest.mark.slow
@pytest.mark.usefixtures("recorded")
def test_a_refusal_of_this_version_while_sending_keeps_the_session(
    terminal: Terminal, counting: Counting
) -> None:
    refusal = problem(426, "client_too_old", "2.0 is wanted")

    assert terminal.run(always("/submissions", refusal, counting))[0] == 4
    assert terminal.states() == ["queued"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--server", "http://127.0.0.1:1"), 3, "cannot be reached"),
        (("--server", "somewhere"), 2, "give an address such as"),
        (("--configurations", "quick"), 2, "no configuration 'quick'"),
        (("--device", "abacus"), 3, "or WebAssembly device matches 'abacus'"),
    ],
)
def test_what_cannot_be_measured_here_is_said_in_one_line(
    options: tuple[str, ...], code: int, words: str, terminal: Terminal, counting: Counting
) -> None:
    ended, _, error = terminal.run(counting, *options)

    assert (ended, words in error) == (code, True), error


@pytest.mark.slow
def test_when_nothing_runs_here_the_reasons_are_sent_and_said(terminal: Terminal, counting: Counting) -> None:
    for configuration in counting.manifest["configurations"]:
        configuration["parameters"] = {"compute_size_ratio": 7}

    code, _, error = terminal.run(counting)

    assert code == 3
    assert "no configuration runs here: ConfigurationError: compute_size_ratio=7" in error
    assert terminal.states() == ["accepted"]


@pytest.mark.slow
@pytest.mark.usefixtures("recorded")
def test_status_export_choose_and_erase_tell_of_what_was_measured(
    terminal: Terminal, counting: Counting
) -> None:
    terminal.run(counting)
    [session_id] = counting.sessions

    status = terminal("status")[1]
    exported: dict[str, Any] = json.loads(terminal("export")[1])
    chosen: dict[str, Any] = json.loads(terminal("choose", "--max-ate", "0.05", "--json")[1])
    code, erased, _ = terminal("erase", "--yes")

    assert "accepted" in status
    [here] = exported["here"]
    assert here["payload"]["sessions"][0]["id"] == session_id
    assert exported["servers"] == {terminal.server.url: {"sessions": [session_id]}}
    assert chosen["configuration"] in ("default", "best")
    assert chosen["parameters"] == room.CONFIGURATIONS[chosen["configuration"]]
    assert (code, counting.sessions) == (0, {})
    assert f"Erased at {terminal.server.url}." in erased
    assert terminal("status")[1] == "Nothing was measured here yet.\n"
    assert terminal("choose")[0] == 3


@pytest.mark.slow
@pytest.mark.usefixtures("recorded")
def test_send_waits_as_long_as_it_takes_when_asked_to(terminal: Terminal, counting: Counting) -> None:
    busy = problem(503, "busy", Retry_After="0")
    terminal.run(at_first("/submissions", busy, busy, then=counting))
    assert terminal.states() == ["queued"]

    code, out, error = terminal("send", "--wait")

    assert code == 0, error
    assert "1 to send; next attempt in 1 s" in out
    assert terminal.states() == ["accepted"]


@pytest.mark.slow
def test_a_reader_that_goes_away_stops_no_measurement(
    serve: Serve, home: Home, terminal: Terminal, counting: Counting
) -> None:
    process = start(home, "run", "--server", serve(counting).url, "--yes")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()

    error = process.stderr.read()
    process.stderr.close()

    assert (process.wait(timeout=120), error) == (0, "")
    assert terminal.states() == ["accepted"]


@pytest.mark.slow
@pytest.mark.usefixtures("recorded")
def test_what_the_named_backend_cannot_run_is_left_out_or_fails_with_the_reason(
    terminal: Terminal, counting: Counting
) -> None:
    if not list_devices("webgpu"):
        pytest.skip("no device over webgpu here")
    for configuration in counting.manifest["configurations"][1:]:
        configuration["backends"] = ["opencl"]

    code, out, error = terminal.run(counting, "--backend", "webgpu", "--configurations", "all")

    assert code == 0, error
    assert out.count("Note: indivisible does not fit WebGPU here and is left out") == 1
    assert "over WebGPU" in out
    assert "best: failed, best does not run on webgpu: it needs opencl" in out
    [session] = counting.sessions.values()
    assert [run["status"] for run in session["runs"]] == ["ok", "failed"]
