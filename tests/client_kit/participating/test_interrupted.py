"""What comes in between while the client measures or sends: Ctrl-C, erasure, heat, another consent text."""

import gzip
import json
import os
import signal
import threading
from dataclasses import replace
from typing import Any

import pytest

from client_kit import interrupts
from client_kit.client import Client
from client_kit.delivery import enrolment
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.spool import Spool
from client_kit.device import preflight
from client_kit.device.preflight import Concern
from client_kit.errors import UsageError
from client_kit.home import Home
from client_kit.measuring import measurement
from client_kit.measuring.session import Session
from client_kit.participating import participation, result_pages
from tests.builders import manifests
from tests.client_kit import canned
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Reply, Request, problem
from tests.client_kit.terminal import Serve, Terminal, canned_measurement, client, counting

__all__ = ["canned_measurement", "client", "counting"]


def test_ctrl_c_keeps_what_is_finished_for_the_next_send(
    client: Terminal, serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: Any, asked: Any, plan: tuple[str, ...], **__: Any) -> Session:
        whole = canned.measured(asked, plan)
        return replace(whole, runs=whole.runs[:3], interrupted=True)

    monkeypatch.setattr(measurement, "measure", interrupted)
    server = serve(counting)

    code, out, error = client("run", "--yes", "--sessions", "3", "--server", server.url)

    assert code == 130
    assert "Stopped: the 3 finished runs are kept." in out
    assert "sent by the next `send`" in error
    assert client("send")[0] == 0
    [session] = counting.sessions.values()
    assert [run["configuration"] for run in session["runs"]] == ["default", "best", "best"]


def test_a_front_of_forty_points_is_measured_in_sessions_that_are_each_taken(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    counting.manifest["configurations"] += [
        manifests.configuration(f"point-{number}", {}) for number in range(37)
    ]

    code, _, _ = client("run", "--yes", "--configurations", "all", "--server", serve(counting).url)

    assert code == 0
    measured = {run["configuration"] for one in counting.sessions.values() for run in one["runs"]}
    assert len(counting.sessions) == 2
    assert len(measured) == 40


def test_whether_the_model_may_be_shown_is_sent_only_when_it_was_said(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    server = serve(counting)

    for option in ([], ["--show-model"], ["--hide-model"]):
        assert client("run", "--yes", "--server", server.url, *option)[0] == 0

    bodies = [r.body for r in server.requests if r.path.endswith("/submissions")]
    assert [json.loads(gzip.decompress(body)).get("show_model") for body in bodies] == [None, True, False]


def test_the_place_and_the_page_are_printed_after_sending(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    server = serve(counting)

    _, out, _ = client("run", "--yes", "--server", server.url)

    assert "Mean time a frame, by stage" in out
    assert "Place 1 of 2 devices by speedup" in out
    assert f"Among the others: {server.url}/devices/a-phone/" in out
    assert f"anyone with the link can read it): {server.url}/mine/signed/" in out


def test_a_crowd_that_cannot_be_asked_for_spoils_nothing(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    def shy(request: Request) -> Reply:
        return Reply(200, {"results": 7}) if "/speedups" in request.path else counting(request)

    code, out, _ = client("run", "--yes", "--server", serve(shy).url)

    assert code == 0
    assert "The rank among other devices could not be requested" in out
    assert "Among the others: " in out


def test_erased_while_it_measures_nothing_is_kept_or_sent(
    client: Terminal, serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    def erasing(_: Any, asked: Manifest, plan: tuple[str, ...], **__: Any) -> Session:
        assert Client(home=home.path).erase()
        return canned.measured(asked, plan)

    monkeypatch.setattr(measurement, "measure", erasing)
    server = serve(counting)

    code, _, error = client("run", "--yes", "--server", server.url)

    assert code == 3
    assert "your agreement was withdrawn meanwhile" in error
    assert Spool(home.spool).items() == []
    assert not [path for path in server.paths() if "enrol" in path or "submissions" in path]


def test_erased_between_two_runs_the_session_ends_at_once(
    client: Terminal, serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    def erasing(_: Any, asked: Manifest, plan: tuple[str, ...], keep: Any, **__: Any) -> Session:
        whole = canned.measured(asked, plan)
        keep(whole)
        assert [draft.id for draft in Spool(home.spool).drafts()] == [whole.id]
        assert Client(home=home.path).erase()
        keep(whole)
        raise AssertionError("the session went on")

    monkeypatch.setattr(measurement, "measure", erasing)

    code, _, error = client("run", "--yes", "--server", serve(counting).url)

    assert code == 3
    assert "your agreement was withdrawn meanwhile" in error
    assert Spool(home.spool).items() + Spool(home.spool).drafts() == []
    assert counting.sessions == {}


def test_erased_while_it_sends_what_arrived_is_erased_there_too(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    erased: list[bool] = []
    erasing = threading.Thread(target=lambda: erased.append(Client(home=home.path).erase()))

    def answer(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            erasing.start()
            while Spool(home.spool).items():
                pass
        return counting(request)

    server = serve(answer)

    code, _, error = client("run", "--yes", "--server", server.url)
    erasing.join()

    assert code == 3
    assert "your agreement was withdrawn meanwhile" in error
    assert erased == [True]
    assert server.paths()[-1] == "DELETE /api/v1/me"
    assert (counting.sessions, enrolment.all_enrolments(home), Spool(home.spool).items()) == ({}, [], [])


def test_a_new_consent_text_is_asked_for_and_what_waits_goes_with_it(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    def strict(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            version = json.loads(gzip.decompress(request.body))["consent_version"]
            if version != counting.manifest["consent_version"]:
                return problem(400, "consent_outdated", "the text is another one")
        return counting(request)

    asked = Manifest.parse(counting.manifest)
    counting.manifest["consent_version"] = 3
    server = serve(strict)
    Spool(home.spool).put(server.url, canned.payload(asked))

    code, out, _ = client("run", "--yes", "--server", server.url)

    assert code == 0
    assert "agree again with `run`" in out
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"] * 2


def test_a_device_that_stays_hot_ends_with_the_sessions_that_are_done(
    client: Terminal, serve: Serve, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    hot = Concern("throttling", "the device throttles", stops=True)
    busy = Concern("load", "other programs keep this device busy", stops=False)
    looks = iter([[], [hot], [hot, busy], [busy]])
    monkeypatch.setattr(preflight, "concerns", lambda *_, **__: next(looks, [hot]))
    monkeypatch.setattr(participation, "COOLING_SECONDS", 0.0)

    code, out, _ = client("run", "--yes", "--sessions", "3", "--server", serve(counting).url)

    assert code == 0
    assert len(counting.sessions) == 2
    assert "No further session: the device throttles" in out
    assert "2 of 3 sessions are done." in out
    assert "other programs" not in out


@pytest.mark.parametrize(
    "state",
    [
        {"device": None, "summarised": False},
        {"device": "a-phone", "summarised": True, "sessions": [
            {"speedups": [{"configuration": "best", "state": "suspect", "reason": "slowed down"}]}
        ]},
    ],
)  # fmt: skip
def test_a_speedup_that_does_not_count_has_no_place(
    state: dict[str, Any],
    client: Terminal,
    serve: Serve,
    counting: Counting,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(result_pages, "SUMMARY_PATIENCE_SECONDS", 0.0)

    def answer(request: Request) -> Reply:
        return Reply(200, state) if "/submissions/" in request.path else counting(request)

    code, out, _ = client("run", "--yes", "--server", serve(answer).url)

    assert code == 0
    assert "Place " not in out


def test_a_silent_client_never_waits_for_an_answer(
    serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)

    with pytest.raises(UsageError, match="no terminal to ask for agreement"):
        Client(serve(counting).url, home.path).run()


def test_the_consent_text_shows_the_wish_about_the_model(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    out = client("run", "--yes", "--show-model", "--server", serve(counting).url)[1]

    assert '"show_model": true' in out


def test_ctrl_c_while_a_session_is_kept_waits_until_it_is(
    client: Terminal, serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    put = Spool.put

    def disturbed(*arguments: Any) -> Any:
        for number in interrupts.ENDING:
            os.kill(os.getpid(), number)
        return put(*arguments)

    monkeypatch.setattr(Spool, "put", disturbed)
    before = [signal.getsignal(number) for number in interrupts.ENDING]

    try:
        code = client("run", "--yes", "--server", serve(counting).url)[0]
    finally:
        for number, handler in zip(interrupts.ENDING, before, strict=True):
            signal.signal(number, handler)

    assert code == 0
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"]
