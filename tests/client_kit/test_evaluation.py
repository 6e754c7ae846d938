"""Serving as a reference device: what a machine does with leases, whatever the server and the network do."""

import io
import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit import evaluation
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.errors import CannotMeasureError, HomeError, UsageError
from client_kit.evaluation import serve
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.isolated import CannotMeasureHereError, LeaseLostError, Measurement, MeasurementError
from tests.client_kit import room
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem

MEASURED = Measurement(
    {"runtime": 0.02, "ate_max": 0.01},
    {"computation": 0.02},
    {"name": "Board GPU", "driver": "1"},
    ({"sequence": "room", "lost": 1, "runtime": 0.02, "ate_max": 0.01},),
)


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


class Lab:
    """A server with LEASES to give, which answers heartbeats and results as the test says."""

    def __init__(self, pack: Pack, leases: int = 1) -> None:
        self.left, self.packs = leases, [pack]
        self.sequence = room.manifest(pack)["sequence"]
        self.results: list[dict[str, Any]] = []
        self.heartbeat = Reply(200, {"lease_seconds": 90})
        self.refusals: list[Reply] = []
        self.unreadable = 0  # leases of a version that this client does not know
        self.trouble: list[Reply] = []  # before a part of the sequence is given
        self.heartbeat_seconds = 15.0
        self.backend = {"backend": "opencl"}  # older servers do not name it
        self.more: dict[str, Any] = {}  # what newer servers tell of several sequences
        self.server = ScriptedServer(self.answer)

    def answer(self, request: Request) -> Reply:
        if request.path.startswith("/sequences/"):
            if self.trouble:
                return self.trouble.pop(0)
            digest = request.path.rpartition("/")[2]
            chunks = [pack._chunks.folder / "chunks" / digest for pack in self.packs]
            return Reply(raw=next(chunk.read_bytes() for chunk in chunks if chunk.exists()))
        assert request.headers["authorization"] == "Bearer secret"
        if request.path.endswith("/heartbeat"):
            return self.heartbeat
        if self.refusals:
            return self.refusals.pop(0)
        if request.path.endswith("/result"):
            self.results.append(json.loads(request.body))
            return Reply(200, {"state": "done"})
        if not self.left:
            return Reply(204, raw=b"")
        self.left -= 1
        if self.left < self.unreadable:
            return Reply(201, {"id": "6-1", "tasks": []})
        return Reply(201, self.lease())

    def lease(self) -> dict[str, Any]:
        return {
            "id": "5-1",
            "application": "kfusion",
            "configuration": {"volume_resolution": 64},
            "frames": 11,
            **self.backend,
            "opencl_device": "GPU",
            "sequence": self.sequence,
            **self.more,
            "lease_seconds": 90,
            "heartbeat_seconds": self.heartbeat_seconds,
            "timeout_seconds": 900,
        }


@pytest.fixture
def serve_lab(tmp_path: Path) -> Callable[[Lab], tuple[str, list[float]]]:
    """Serves a lab until nothing waits: what was said, and how long was waited."""

    def served(lab: Lab) -> tuple[str, list[float]]:
        pauses: list[float] = []
        home, said = Home(tmp_path / "home"), io.StringIO()
        home.prepare()
        try:
            server = Server(lab.server.url)
            serve(server, "board", "secret", home, Console(said), until_idle=True, pause=pauses.append)
        finally:
            lab.server.close()
        return said.getvalue(), pauses

    return served


@pytest.fixture(autouse=True)
def choices(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, tuple[str, ...]]]:
    """For which device and backends a machine with one GPU was asked; OpenCL drives it, where it may."""
    asked: list[tuple[str, tuple[str, ...]]] = []

    def choose(text: str, backends: tuple[str, ...]) -> SimpleNamespace:
        asked.append((text, backends))
        return SimpleNamespace(label=f"Board {text} (a platform, 1, driver 1)", backend=backends[0])

    monkeypatch.setattr(evaluation.selection, "choose", choose)
    return asked


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What was measured; each measurement makes one heartbeat and gives MEASURED."""
    calls: list[dict[str, Any]] = []

    def measure(system: str, configuration: Any, packs: list[Path], **wishes: Any) -> Measurement:
        calls.append({"system": system, "configuration": configuration, "packs": packs, **wishes})
        if not wishes["heartbeat"]():
            raise LeaseLostError
        return MEASURED

    monkeypatch.setattr(evaluation.isolated, "measure", measure)
    return calls


def test_a_lease_is_measured_and_its_result_told(pack: Pack, serve_lab: Any, measured: list[Any]) -> None:
    lab = Lab(pack, leases=2)

    serve_lab(lab)

    (first, second), results = measured, lab.results
    assert (first["system"], first["configuration"]) == ("kfusion", {"volume_resolution": 64})
    assert (first["frames"], first["timeout"]) == (11, 900)
    assert (first["device"], first["backend"]) == ("Board GPU (a platform, 1, driver 1)", "opencl")
    (folder,) = first["packs"]
    assert json.loads((folder / "pack.json").read_text())["sha256"] == pack.sha256
    assert (first["perturbation"], first["stop_above"]) == (None, None)
    assert [result["status"] for result in results] == ["done", "done"]
    assert results[0]["objectives"] == MEASURED.objectives
    assert results[0]["configuration"] == {"volume_resolution": 64}
    chunks = [path for path in lab.server.paths() if "/sequences/" in path]
    assert len(chunks) == len(set(chunks))  # downloaded once
    assert first["packs"] == second["packs"]


def several(pack: Pack, folder: Path) -> tuple[Lab, Pack]:
    """A lab whose lease names two sequences, and the second one."""
    other = room.write(folder / "other", name="other")
    lab = Lab(pack)
    lab.packs.append(other)
    sequences = [lab.sequence, room.manifest(other)["sequence"]]
    lab.more = {"sequences": sequences, "perturbation": 3, "stop_above": 0.05}
    lab.more |= {"stop_after": 2, "learned_on": 1}
    return lab, other


def test_all_sequences_of_a_lease_are_downloaded_and_measured_as_it_says(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any]
) -> None:
    lab, other = several(pack, tmp_path)

    serve_lab(lab)

    [call] = measured
    names = [json.loads((folder / "pack.json").read_text())["name"] for folder in call["packs"]]
    assert names == ["room", "other"]
    assert (call["perturbation"], call["stop_above"], call["stop_after"]) == (3, 0.05, 2)
    assert call["learned_on"] == 1
    asked = json.loads(
        next(request.body for request in lab.server.requests if request.path.endswith("/leases"))
    )
    assert asked["lease_version"] == 2
    assert other.sha256 != pack.sha256


def test_the_parts_of_a_measurement_are_sent(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any]
) -> None:
    lab, _ = several(pack, tmp_path)

    said, _ = serve_lab(lab)

    assert lab.results[0]["parts"] == [
        {"sequence": "room", "lost": 1, "objectives": {"runtime": 0.02, "ate_max": 0.01}}
    ]
    assert "at least 1.00 cm over 1 of 2 sequences" in said


@pytest.mark.parametrize(
    "more",
    [
        {"sequences": [{"name": "room"}]},
        {"sequences": "room"},
        {"perturbation": "much"},
        {"stop_above": "far"},
    ],
)
def test_a_lease_with_sequences_that_cannot_be_read_is_given_back(
    more: dict[str, Any], pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.more = more

    serve_lab(lab)

    assert [result["status"] for result in lab.results] == ["returned"]
    assert "the lease cannot be read" in lab.results[0]["error"]
    assert not measured


def test_a_server_that_wants_a_newer_client_is_asked_again_later(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.refusals = [problem(409, "client_outdated", "this client cannot: update it")]

    said, _ = serve_lab(lab)

    assert "this client cannot: update it" in said
    assert [result["status"] for result in lab.results] == ["done"]


@pytest.mark.parametrize(
    ("named", "measures"),
    [({"backend": "webgpu"}, "webgpu"), ({"backend": "opencl"}, "opencl"), ({}, "opencl")],
)
def test_the_backend_that_the_lease_names_measures(
    named: dict[str, str],
    measures: str,
    pack: Pack,
    serve_lab: Any,
    measured: list[Any],
    choices: list[Any],
) -> None:
    lab = Lab(pack)
    lab.backend = named

    serve_lab(lab)

    assert choices == [("GPU", (measures,))]
    assert [call["backend"] for call in measured] == [measures]


@pytest.mark.parametrize("wanted", ["opencl", "webgpu"])
def test_a_lease_of_another_backend_than_is_wanted_is_given_back_with_both(
    wanted: str, pack: Pack, home: Home, measured: list[Any], choices: list[Any]
) -> None:
    lab, other = Lab(pack), "webgpu" if wanted == "opencl" else "opencl"

    def serve_lease(backend: str) -> None:
        lab.left, lab.backend = 1, {"backend": backend}
        console = Console(io.StringIO())
        serve(Server(lab.server.url), "board", "secret", home, console, until_idle=True, backend=wanted)

    serve_lease(wanted)
    with pytest.raises(CannotMeasureError) as ended:
        serve_lease(other)
    lab.server.close()

    reason = f"--backend {wanted}: the server has board measure over {other}"
    assert (str(ended.value), ended.value.exit_code) == (reason, 3)
    assert [(result["status"], result.get("error")) for result in lab.results] == [
        ("done", None),
        ("returned", reason),
    ]
    assert choices == [("GPU", (wanted,))]
    assert [call["backend"] for call in measured] == [wanted]


def test_a_failure_is_told_with_its_reason(
    pack: Pack, serve_lab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> Measurement:
        raise MeasurementError("killed by SIGSEGV")

    monkeypatch.setattr(evaluation.isolated, "measure", fail)
    lab = Lab(pack)

    serve_lab(lab)

    assert [(result["status"], result["error"]) for result in lab.results] == [
        ("failed", "killed by SIGSEGV")
    ]


def test_a_lease_that_is_gone_ends_its_measurement(pack: Pack, serve_lab: Any, measured: list[Any]) -> None:
    lab = Lab(pack)
    lab.heartbeat = problem(410, "lease_gone", "taken over")

    said, _ = serve_lab(lab)

    assert lab.results == []
    assert "the lease is gone" in said


def test_a_server_in_trouble_does_not_end_a_measurement_and_gets_the_result_later(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.heartbeat = problem(503, "database_unavailable")
    trouble = problem(503, "database_unavailable", "restarting", Retry_After="7")

    def answer(request: Request) -> Reply:
        if request.path.endswith("/result") and not lab.results and len(refused) < 3:
            refused.append(request)
            return trouble
        return lab.answer(request)

    refused: list[Request] = []
    lab.server.answer = answer

    _, pauses = serve_lab(lab)

    assert pauses == [7.0] * 3
    assert [result["status"] for result in lab.results] == ["done"]


def test_a_result_that_was_not_told_is_told_by_the_next_process(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any]
) -> None:
    home, said, lab = Home(tmp_path / "home"), io.StringIO(), Lab(pack)
    home.prepare()
    away = problem(503, "database_unavailable")

    def interrupted(_: float) -> None:
        raise KeyboardInterrupt

    lab.server.answer = lambda request: away if request.path.endswith("/result") else lab.answer(request)
    with pytest.raises(KeyboardInterrupt):
        serve(Server(lab.server.url), "board", "secret", home, Console(said), pause=interrupted)
    assert "its result is stored here and sent by the next `evaluate`" in said.getvalue()

    lab.server.answer = lab.answer
    told, _ = serve_lab(lab)

    assert "5-1: its result is still to be sent" in told
    assert [result["status"] for result in lab.results] == ["done"]
    assert len(measured) == 1
    assert home.read(evaluation.RESULTS) == {}


def test_a_result_that_cannot_be_kept_is_told_all_the_same(
    pack: Pack, serve_lab: Any, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_home: Home, name: str, _document: Any) -> None:
        raise HomeError(f"{name} cannot be written: No space left on device")

    monkeypatch.setattr(Home, "write", full)
    lab = Lab(pack, leases=2)

    said, _ = serve_lab(lab)

    assert "No space left on device" in said
    assert [result["status"] for result in lab.results] == ["done", "done"]


def test_a_kept_result_that_cannot_be_dropped_is_told_once_by_a_process(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    home, lab = Home(tmp_path / "home"), Lab(pack)
    home.prepare()
    kept = {"lease": "4-1", "result": {"status": "failed", "error": "killed"}}
    home.write(evaluation.RESULTS, {f"{lab.server.url} board": kept})

    def full(_home: Home, name: str, _document: Any) -> None:
        raise HomeError(f"{name} cannot be written: No space left on device")

    monkeypatch.setattr(Home, "write", full)

    serve_lab(lab)

    assert [result["status"] for result in lab.results] == ["failed", "done"]


def test_while_another_client_measures_nothing_is_asked_for(
    pack: Pack, tmp_path: Path, measured: list[Any]
) -> None:
    home, said, lab = Home(tmp_path / "home"), io.StringIO(), Lab(pack)
    home.prepare()
    other = ExitStack()
    assert other.enter_context(home.only_one("measurement"))
    asked: list[int] = []

    def until_it_is_done(_: float) -> None:
        asked.append(len(lab.server.requests))
        if len(asked) == 2:
            other.close()

    try:
        server = Server(lab.server.url)
        serve(server, "board", "secret", home, Console(said), until_idle=True, pause=until_it_is_done)
    finally:
        lab.server.close()

    assert asked == [0, 0]
    assert said.getvalue().count("Another client measures on this device") == 1
    assert [result["status"] for result in lab.results] == ["done"]


def test_while_its_server_is_away_another_client_may_measure(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    home.prepare()
    free: list[bool] = []

    def pause(_: float) -> None:
        with home.only_one("measurement") as alone:
            free.append(alone)
        raise KeyboardInterrupt

    away = Server("http://127.0.0.1:9")
    with pytest.raises(KeyboardInterrupt):
        serve(away, "board", "secret", home, Console(io.StringIO()), pause=pause)

    assert free == [True]


def test_what_another_client_overtakes_is_given_back(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    lab, other = Lab(pack, leases=2), ExitStack()
    lease, finish = Server.lease, Server.finish

    # SQLite's lock has to be released by the thread that took it: not by one of the scripted server.
    def overtaken(server: Server, *arguments: Any) -> Any:
        answer = lease(server, *arguments)
        if lab.left == 1:  # between the question and the measurement
            assert other.enter_context(Home(tmp_path / "home").only_one("measurement"))
        return answer

    def finished(server: Server, *arguments: Any) -> None:
        other.close()
        finish(server, *arguments)

    monkeypatch.setattr(Server, "lease", overtaken)
    monkeypatch.setattr(Server, "finish", finished)

    serve_lab(lab)

    assert [result["status"] for result in lab.results] == ["returned", "done"]
    assert len(measured) == 1


def test_a_server_that_restarts_during_the_download_ends_nothing(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.trouble = [problem(503, "starting", Retry_After="3")] * 5  # more than one download stands

    said, pauses = serve_lab(lab)

    assert pauses == [3.0] * 5
    assert "again in 3 s" in said
    assert [result["status"] for result in lab.results] == ["done"]


def test_a_long_download_holds_its_lease_and_ends_when_that_is_gone(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.heartbeat_seconds = 0.0
    lab.heartbeat = problem(410, "lease_gone", "taken over")

    said, _ = serve_lab(lab)

    assert "the lease is gone" in said
    assert (measured, lab.results) == ([], [])


def test_a_lease_that_cannot_be_read_is_given_back_and_ends_nothing(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack, leases=2)
    lab.unreadable = 1

    said, pauses = serve_lab(lab)

    assert [result["status"] for result in lab.results] == ["done", "returned"]
    assert "the lease cannot be read" in lab.results[1]["error"]
    assert "the lease cannot be read" in said
    assert evaluation.LONGEST_PAUSE_SECONDS in pauses


def test_a_machine_that_cannot_measure_gives_back_with_the_reason_and_ends(
    pack: Pack, serve_lab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(*_: Any, **__: Any) -> Measurement:
        raise CannotMeasureHereError("no OpenCL device here")

    monkeypatch.setattr(evaluation.isolated, "measure", nothing)
    lab = Lab(pack, leases=2)

    with pytest.raises(CannotMeasureError, match="no OpenCL device here") as ended:
        serve_lab(lab)

    assert ended.value.exit_code == 3
    assert lab.results == [{"status": "returned", "error": "no OpenCL device here"}]


def test_ctrl_c_has_its_exit_code_and_promises_nothing(
    pack: Pack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any, **__: Any) -> Measurement:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation.isolated, "measure", interrupted)
    monkeypatch.setenv("FRONTRUNNER_HOME", str(tmp_path))
    lab = Lab(pack)
    try:
        code = command_line.main(
            ["evaluate", "--server", lab.server.url, "--device", "board", "--token", "secret"]
        )
    finally:
        lab.server.close()

    assert code == 130
    assert capsys.readouterr().err == "frontrunner: stopped\n"


def test_ctrl_c_gives_the_evaluation_back(
    pack: Pack, serve_lab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any, **__: Any) -> Measurement:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation.isolated, "measure", interrupted)
    lab = Lab(pack)

    with pytest.raises(KeyboardInterrupt):
        serve_lab(lab)
    assert lab.results == [{"status": "returned"}]


@pytest.mark.parametrize(
    "refusal",
    [problem(401, "token_invalid", "ask for a new one"), problem(403, "another_device", "belongs to tv")],
)
def test_a_token_that_does_not_open_this_device_is_a_usage_error(
    pack: Pack, serve_lab: Any, refusal: Reply
) -> None:
    lab = Lab(pack)
    lab.refusals = [refusal]
    with pytest.raises(UsageError, match=f"{refusal.document['detail']}.*{refusal.document['code']}"):
        serve_lab(lab)


def test_a_missing_token_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FRONTRUNNER_HOME", str(tmp_path))
    monkeypatch.delenv(command_line.TOKEN_VARIABLE, raising=False)
    assert command_line.main(["evaluate", "--server", "http://127.0.0.1:1", "--device", "board"]) == 2
    assert command_line.TOKEN_VARIABLE in capsys.readouterr().err
