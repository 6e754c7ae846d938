"""A reference device while its server is away, another client measures, or its user stops it."""

import io
from contextlib import ExitStack
from typing import Any

import pytest

from client_kit import evaluation
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.errors import HomeError
from client_kit.evaluation import serve
from client_kit.home import Home
from tests.client_kit.commands import Terminal
from tests.client_kit.evaluation.lab import Lab, failing
from tests.client_kit.scripted import always, at_first, problem

AWAY = problem(503, "database_unavailable")


def fill_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_home: Home, name: str, _document: Any) -> None:
        raise HomeError(f"{name} cannot be written: No space left on device")

    monkeypatch.setattr(Home, "write", full)


def interrupted(_: float) -> None:
    raise KeyboardInterrupt


def test_a_server_in_trouble_does_not_end_a_measurement_and_gets_the_result_later(
    lab: Lab, measured: list[Any]
) -> None:
    lab.heartbeat = AWAY
    restarting = problem(503, "database_unavailable", "restarting", Retry_After="7")
    lab.server.answer = at_first("/result", *[restarting] * 3, then=lab.answer)

    lab.serve()

    assert (lab.pauses, lab.states()) == ([7.0] * 3, ["done"])


def test_a_result_that_was_not_sent_is_sent_by_the_next_process(lab: Lab, measured: list[Any]) -> None:
    lab.server.answer = always("/result", AWAY, lab.answer)
    with pytest.raises(KeyboardInterrupt):
        lab.serve(pause=interrupted)
    assert "its result is stored here and sent by the next `evaluate`" in lab.said.getvalue()

    lab.server.answer = lab.answer

    assert "5-1: its result is still to be sent" in lab.serve()
    assert (lab.states(), len(measured)) == (["done"], 1)
    assert lab.home.read(evaluation.RESULTS) == {}


def test_a_result_that_cannot_be_stored_is_sent_all_the_same(
    lab: Lab, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    fill_disk(monkeypatch)
    lab.left = 2

    assert "No space left on device" in lab.serve()
    assert lab.states() == ["done", "done"]


def test_a_stored_result_that_cannot_be_deleted_is_sent_once_by_a_process(
    lab: Lab, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = {"lease": "4-1", "result": {"status": "failed", "error": "killed"}}
    lab.home.write(evaluation.RESULTS, {f"{lab.server.url} board": kept})
    fill_disk(monkeypatch)

    lab.serve()

    assert lab.states() == ["failed", "done"]


def test_while_another_client_measures_nothing_is_asked_for(lab: Lab, measured: list[Any]) -> None:
    other = ExitStack()
    assert other.enter_context(lab.home.only_one("measurement"))
    asked: list[int] = []

    def until_it_is_done(_: float) -> None:
        asked.append(len(lab.server.requests))
        if len(asked) == 2:
            other.close()

    said = lab.serve(pause=until_it_is_done)

    assert asked == [0, 0]
    assert said.count("Another client measures on this device") == 1
    assert lab.states() == ["done"]


def test_while_its_server_is_away_another_client_may_measure(home: Home) -> None:
    free: list[bool] = []

    def pause(_: float) -> None:
        with home.only_one("measurement") as alone:
            free.append(alone)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        serve(Server("http://127.0.0.1:9"), "board", "secret", home, Console(io.StringIO()), pause=pause)

    assert free == [True]


def test_what_another_client_overtakes_is_given_back(
    lab: Lab, measured: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    lab.left, other = 2, ExitStack()
    lease, finish = Server.lease, Server.finish

    # SQLite's lock has to be released by the thread that took it: not by one of the scripted server.
    def overtaken(server: Server, *arguments: Any) -> Any:
        answer = lease(server, *arguments)
        if lab.left == 1:  # between the question and the measurement
            assert other.enter_context(lab.home.only_one("measurement"))
        return answer

    def finished(server: Server, *arguments: Any) -> None:
        other.close()
        finish(server, *arguments)

    monkeypatch.setattr(Server, "lease", overtaken)
    monkeypatch.setattr(Server, "finish", finished)

    lab.serve()

    assert (lab.states(), len(measured)) == (["returned", "done"], 1)


def test_a_server_that_restarts_during_the_download_ends_nothing(lab: Lab, measured: list[Any]) -> None:
    lab.trouble = [problem(503, "starting", Retry_After="3")] * 5  # more than one download stands

    assert "again in 3 s" in lab.serve()
    assert (lab.pauses, lab.states()) == ([3.0] * 5, ["done"])


def test_ctrl_c_gives_the_evaluation_back(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, KeyboardInterrupt())

    with pytest.raises(KeyboardInterrupt):
        lab.serve()

    assert lab.results == [{"status": "returned"}]


def test_ctrl_c_has_its_exit_code_and_promises_nothing(
    lab: Lab, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, KeyboardInterrupt())

    arguments = ("evaluate", "--server", lab.server.url, "--device", "board", "--token", "secret")
    code, _, error = terminal(*arguments)

    assert (code, error) == (130, "frontrunner: stopped\n")
