"""`python -m client_kit run` as its user runs it: a process of its own, against a server on a socket."""

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from client_kit.delivery.spool import Spool
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.devices.choice import list_devices
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.commands import client, start
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem

Serve = Callable[..., ScriptedServer]
PROJECT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("room"))


@pytest.fixture
def counting(pack: Pack) -> Counting:
    """A server that asks for one run of default and one of best, which is enough for most of what follows."""
    short = {"warmup_frames": 0, "order": ["default", "best"], "repeats": 1}
    protocol = {**manifests.manifest()["protocol"], **short}
    return Counting(room.manifest(pack, protocol=protocol), pack._chunks.folder / "chunks")


def states(home: Home) -> list[str]:
    return [item.state for item in Spool(home.spool).items()]


def test_a_first_run_asks_measures_sends_and_shows_the_speedup(
    serve: Serve, home: Home, counting: Counting
) -> None:
    counting.manifest["protocol"] = manifests.manifest()["protocol"]
    scripted = serve(counting)

    done = client(home, "run", "--server", scripted.url, "--yes")

    assert done.returncode == 0, done.stderr
    assert "What is sent, with the values of this device" in done.stdout
    assert '"opencl_device": "' in done.stdout
    assert "Downloading the sequence room" in done.stdout
    assert "Speedup of best over default: " in done.stdout
    assert "largest trajectory error" in done.stdout
    assert f"{scripted.url}/devices/a-phone/" in done.stdout
    [session] = counting.sessions.values()
    assert [run["configuration"] for run in session["runs"]] == ["default", "best", "best", "default"]
    assert states(home) == ["accepted"]


@pytest.mark.slow
def test_a_second_run_asks_for_nothing_again(serve: Serve, home: Home, counting: Counting) -> None:
    scripted = serve(counting)
    client(home, "run", "--server", scripted.url, "--yes")
    before = len(scripted.requests)

    done = client(home, "run", "--server", scripted.url, "--configurations", "all")

    assert done.returncode == 0, done.stderr
    assert "What is sent" not in done.stdout
    assert not [path for path in scripted.paths()[before:] if "sequences" in path or "enrol" in path]
    assert "indivisible: failed" in done.stdout
    assert len(counting.sessions) == 2
    assert [len(session["runs"]) for session in counting.sessions.values()] == [2, 3]


@pytest.mark.slow
def test_without_consent_nothing_is_measured_or_sent(serve: Serve, home: Home, counting: Counting) -> None:
    scripted = serve(counting)

    done = client(home, "run", "--server", scripted.url)

    assert done.returncode == 2
    assert "add --yes" in done.stderr
    assert len(scripted.requests) == 1  # the manifest
    assert states(home) == []


@pytest.mark.slow
def test_a_server_that_goes_away_gets_the_session_with_the_next_command(
    serve: Serve, home: Home, counting: Counting
) -> None:
    def broken(request: Request) -> Reply:
        return Reply(503, raw=b"") if "enrol" in request.path else counting(request)

    scripted = serve(broken)
    done = client(home, "run", "--server", scripted.url, "--yes")

    assert done.returncode == 0, done.stderr
    assert f"Not sent: {scripted.url}" in done.stdout
    assert "stored on this device" in done.stdout
    assert "Speedup of best over default: " in done.stdout
    assert states(home) == ["queued"]

    scripted.answer = counting
    sent = client(home, "send")
    assert sent.returncode == 0
    assert "accepted" in sent.stdout
    assert len(counting.sessions) == 1


@pytest.mark.slow
def test_a_device_without_a_network_measures_what_it_knows(
    serve: Serve, home: Home, counting: Counting
) -> None:
    scripted = serve(counting)
    client(home, "run", "--server", scripted.url, "--yes")
    scripted.close()

    done = client(home, "run", "--server", scripted.url)

    assert done.returncode == 0, done.stderr
    assert "using its manifest from the last visit" in done.stdout
    assert states(home) == ["accepted", "queued"]


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["/manifest", "/sequences/", "/enrol", "/submissions", "/submissions/"])
def test_killed_at_any_request_it_ends_with_every_session_counted_once(
    moment: str, serve: Serve, home: Home, counting: Counting
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
    measured = len(states(home))

    scripted.answer = counting
    done = client(home, "run", "--server", scripted.url, "--yes")

    assert done.returncode == 0, done.stderr
    assert states(home) == ["accepted"] * (measured + 1)
    assert len(counting.sessions) == measured + 1
    assert len(counting.runs) == len(set(counting.runs)) == 2 * (measured + 1)


def test_a_version_that_is_refused_has_its_own_exit_code(
    serve: Serve, home: Home, counting: Counting
) -> None:
    counting.manifest["minimum_app_version"] = "9.0"
    scripted = serve(counting)

    done = client(home, "run", "--server", scripted.url, "--yes")

    assert (done.returncode, states(home)) == (4, [])
    assert "update it" in done.stderr


@pytest.mark.slow
def test_a_refusal_of_this_version_while_sending_keeps_the_session(
    serve: Serve, home: Home, counting: Counting
) -> None:
    def refusing(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            return problem(426, "client_too_old", "2.0 is wanted")
        return counting(request)

    done = client(home, "run", "--server", serve(refusing).url, "--yes")

    assert (done.returncode, states(home)) == (4, ["queued"])


@pytest.mark.slow
def test_what_cannot_be_measured_here_is_said_in_one_line(
    serve: Serve, home: Home, counting: Counting, closed_port: int
) -> None:
    scripted = serve(counting)
    address = f"http://127.0.0.1:{closed_port}"
    cases: dict[tuple[str, ...], tuple[int, str]] = {
        ("--server", address): (3, "cannot be reached"),
        ("--server", "somewhere"): (2, "give an address such as"),
        ("--server", scripted.url, "--configurations", "quick"): (2, "no configuration 'quick'"),
        ("--server", scripted.url, "--device", "abacus"): (
            3,
            "or WebAssembly device matches 'abacus'",
        ),
    }
    for arguments, (code, words) in cases.items():
        done = client(home, "run", "--yes", *arguments)
        assert (done.returncode, len(done.stderr.splitlines())) == (code, 1), done.stderr
        assert words in done.stderr


@pytest.mark.slow
def test_when_nothing_runs_here_the_reasons_are_sent_and_said(
    serve: Serve, home: Home, counting: Counting
) -> None:
    for configuration in counting.manifest["configurations"]:
        configuration["parameters"] = {"compute_size_ratio": 7}

    done = client(home, "run", "--server", serve(counting).url, "--yes")

    assert done.returncode == 3
    assert "no configuration runs here: ConfigurationError: compute_size_ratio=7" in done.stderr
    assert states(home) == ["accepted"]


@pytest.mark.slow
def test_status_export_choose_and_erase_tell_of_what_was_measured(
    serve: Serve, home: Home, counting: Counting
) -> None:
    scripted = serve(counting)
    client(home, "run", "--server", scripted.url, "--yes")
    [session_id] = counting.sessions

    status = client(home, "status").stdout
    exported: dict[str, Any] = json.loads(client(home, "export").stdout)
    chosen: dict[str, Any] = json.loads(client(home, "choose", "--max-ate", "0.05", "--json").stdout)
    erased = client(home, "erase", "--yes")

    assert "accepted" in status
    [here] = exported["here"]
    assert here["payload"]["sessions"][0]["id"] == session_id
    assert exported["servers"] == {scripted.url: {"sessions": [session_id]}}
    assert chosen["configuration"] in ("default", "best")
    assert chosen["parameters"] == room.CONFIGURATIONS[chosen["configuration"]]
    assert erased.returncode == 0
    assert f"Erased at {scripted.url}." in erased.stdout
    assert counting.sessions == {}
    assert client(home, "status").stdout == "Nothing was measured here yet.\n"
    assert client(home, "choose").returncode == 3


@pytest.mark.slow
def test_send_waits_as_long_as_it_takes_when_asked_to(serve: Serve, home: Home, counting: Counting) -> None:
    refusals = iter([problem(503, "busy", Retry_After="0")] * 2)

    def busy(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            return next(refusals, None) or counting(request)
        return counting(request)

    scripted = serve(busy)
    client(home, "run", "--server", scripted.url, "--yes")
    assert states(home) == ["queued"]

    done = client(home, "send", "--wait")

    assert done.returncode == 0, done.stderr
    assert "1 to send; next attempt in 1 s" in done.stdout
    assert states(home) == ["accepted"]


@pytest.mark.slow
def test_whoever_stops_reading_stops_no_measurement(serve: Serve, home: Home, counting: Counting) -> None:
    process = start(home, "run", "--server", serve(counting).url, "--yes")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()

    error = process.stderr.read()
    process.stderr.close()

    assert (process.wait(timeout=120), error) == (0, "")
    assert states(home) == ["accepted"]


@pytest.mark.slow
def test_runs_are_compared_with_their_references_and_again_without_a_network(
    serve: Serve, home: Home, counting: Counting, pack: Pack
) -> None:
    counting.manifest["configurations"] = room.manifest(pack, far=("best",))["configurations"]
    scripted = serve(counting)

    done = client(home, "run", "--server", scripted.url, "--yes", "--backend", "opencl")

    assert done.returncode == 0, done.stderr
    assert '"deviation": ' in done.stdout  # in the consent text
    assert "over OpenCL" in done.stdout
    # Once more for each run that other programs disturb.
    line, *_ = [line for line in done.stdout.splitlines() if "computes a different result" in line]
    assert line.endswith("cm from the reference, 2.00 cm allowed), so the run does not count.")
    assert "No speedup for best" in done.stdout
    [session] = counting.sessions.values()
    assert session["protocol_version"] == 2
    assert session["runs"][0]["deviation"] < room.BAND < session["runs"][1]["deviation"]
    fetched = [path for path in scripted.paths() if "trajectories" in path]
    assert len(fetched) == len(set(fetched)) == 2

    scripted.close()
    again = client(home, "run", "--server", scripted.url)
    assert again.returncode == 0, again.stderr
    assert states(home) == ["accepted", "queued"]


@pytest.mark.slow
def test_the_backend_that_is_named_measures(serve: Serve, home: Home, counting: Counting) -> None:
    if not list_devices("webgpu"):
        pytest.skip("no device over webgpu here")
    for configuration in counting.manifest["configurations"][1:]:
        configuration["backends"] = ["opencl"]
    asked = ("--yes", "--backend", "webgpu", "--configurations", "all")

    done = client(home, "run", "--server", serve(counting).url, *asked)

    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Note: indivisible does not fit WebGPU here and is left out") == 1
    assert "over WebGPU" in done.stdout
    assert "best: failed, best does not run on webgpu: it needs opencl" in done.stdout
    [session] = counting.sessions.values()
    assert (session["backend"], session["stage_clock"]) == ("webgpu", "none")
    assert [run["status"] for run in session["runs"]] == ["ok", "failed"]
    assert not any("stages_us" in run for run in session["runs"])
