"""A reference device while its server is away, another client measures, or its user stops it."""

import io
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit import evaluation
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.errors import HomeError
from client_kit.evaluation import serve
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.isolated import Measurement
from tests.client_kit.evaluation.lab import Lab
from tests.client_kit.scripted import Reply, Request, problem


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


def test_a_result_that_was_not_sent_is_sent_by_the_next_process(
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
    output, _ = serve_lab(lab)

    assert "5-1: its result is still to be sent" in output
    assert [result["status"] for result in lab.results] == ["done"]
    assert len(measured) == 1
    assert home.read(evaluation.RESULTS) == {}


def test_a_result_that_cannot_be_stored_is_sent_all_the_same(
    pack: Pack, serve_lab: Any, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_home: Home, name: str, _document: Any) -> None:
        raise HomeError(f"{name} cannot be written: No space left on device")

    monkeypatch.setattr(Home, "write", full)
    lab = Lab(pack, leases=2)

    said, _ = serve_lab(lab)

    assert "No space left on device" in said
    assert [result["status"] for result in lab.results] == ["done", "done"]


def test_a_stored_result_that_cannot_be_deleted_is_sent_once_by_a_process(
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
