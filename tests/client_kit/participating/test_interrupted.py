"""What comes in between while the client measures or sends: Ctrl-C, erasure, heat, another consent text."""

import gzip
import json
import os
import threading
from typing import Any

import pytest
from msgspec.structs import replace

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
from client_kit.measuring.measurement import Observer, Task
from client_kit.measuring.session import Session
from client_kit.participating import participation, result_pages
from tests.builders import manifests
from tests.client_kit import canned
from tests.client_kit.commands import Terminal
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Reply, Request, Serve, always, problem
from tests.waiting import until

pytestmark = pytest.mark.usefixtures("canned_measurement")


def test_ctrl_c_keeps_what_is_finished_for_the_next_send(
    terminal: Terminal, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(task: Task, *_: Any) -> tuple[Session, bool]:
        whole = canned.measured(task.asked, task.plan)
        return replace(whole, runs=whole.runs[:3]), True

    monkeypatch.setattr(measurement, "measure", interrupted)

    code, out, error = terminal.run(counting, "--sessions", "3")

    assert code == 130
    assert "Stopped: the 3 finished runs are kept." in out
    assert "sent by the next `send`" in error
    assert terminal("send")[0] == 0
    [session] = counting.sessions.values()
    assert [run["configuration"] for run in session["runs"]] == ["default", "best", "best"]


def test_a_front_of_forty_points_is_measured_in_sessions_that_are_each_taken(
    terminal: Terminal, counting: Counting
) -> None:
    counting.manifest["configurations"] += [
        manifests.configuration(f"point-{number}", {}) for number in range(37)
    ]

    code, _, _ = terminal.run(counting, "--configurations", "all")

    measured = {run["configuration"] for one in counting.sessions.values() for run in one["runs"]}
    assert (code, len(counting.sessions), len(measured)) == (0, 2, 40)


@pytest.mark.parametrize(
    ("options", "shown"), [([], None), (["--show-model"], True), (["--hide-model"], False)]
)
def test_whether_the_model_may_be_shown_is_sent_only_when_it_was_said(
    options: list[str], shown: bool | None, terminal: Terminal, counting: Counting
) -> None:
    code, out, _ = terminal.run(counting, *options)

    [sent] = terminal.server.submissions()
    assert (code, json.loads(gzip.decompress(sent.body)).get("show_model")) == (0, shown)
    assert ('"show_model": true' in out) == (shown is True)  # in the consent text


def test_the_place_and_the_page_are_printed_after_sending(terminal: Terminal, counting: Counting) -> None:
    _, out, _ = terminal.run(counting)

    url = terminal.server.url
    assert "Mean time a frame, by stage" in out
    assert "Place 1 of 2 devices by speedup" in out
    assert f"Among the others: {url}/devices/a-phone/" in out
    assert f"anyone with the link can read it): {url}/mine/signed/" in out


def test_a_crowd_that_cannot_be_asked_for_spoils_nothing(terminal: Terminal, counting: Counting) -> None:
    code, out, _ = terminal.run(always("/speedups", Reply(200, {"results": 7}), counting))

    assert code == 0
    assert "The rank among other devices could not be requested" in out
    assert "Among the others: " in out


def test_erased_while_it_measures_nothing_is_kept_or_sent(
    terminal: Terminal, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    def erasing(task: Task, *_: Any) -> tuple[Session, bool]:
        assert Client(home=home.path).erase()
        return canned.measure(task)

    monkeypatch.setattr(measurement, "measure", erasing)

    code, _, error = terminal.run(counting)

    assert (code, terminal.states()) == (3, [])
    assert "your agreement was withdrawn meanwhile" in error
    assert not [path for path in terminal.server.paths() if "enrol" in path or "submissions" in path]


def test_erased_between_two_runs_the_session_ends_at_once(
    terminal: Terminal, counting: Counting, home: Home, spool: Spool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def erasing(task: Task, _: Any, observer: Observer, *__: Any) -> tuple[Session, bool]:
        whole, _ = canned.measure(task)
        observer.session(whole)
        assert [draft.id for draft in spool.drafts()] == [str(whole.id)]
        assert Client(home=home.path).erase()
        observer.session(whole)
        raise AssertionError("the session went on")

    monkeypatch.setattr(measurement, "measure", erasing)

    code, _, error = terminal.run(counting)

    assert code == 3
    assert "your agreement was withdrawn meanwhile" in error
    assert (spool.items(), spool.drafts(), counting.sessions) == ([], [], {})


def test_erased_while_it_sends_what_arrived_is_erased_there_too(
    terminal: Terminal, counting: Counting, home: Home, spool: Spool
) -> None:
    erased: list[bool] = []
    erasing = threading.Thread(target=lambda: erased.append(Client(home=home.path).erase()))

    def answer(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            erasing.start()
            until(lambda: not Spool(home.spool).items())
        return counting(request)

    code, _, error = terminal.run(answer)
    erasing.join()

    assert (code, erased) == (3, [True])
    assert "your agreement was withdrawn meanwhile" in error
    assert terminal.server.paths()[-1] == "DELETE /api/v1/me"
    assert (counting.sessions, enrolment.all_enrolments(home), spool.items()) == ({}, [], [])


def test_a_new_consent_text_is_asked_for_and_what_waits_goes_with_it(
    terminal: Terminal, serve: Serve, counting: Counting, spool: Spool
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
    spool.put(server.url, canned.payload(asked))

    code, out, _ = terminal("run", "--yes", "--server", server.url)

    assert (code, terminal.states()) == (0, ["accepted"] * 2)
    assert "agree again with `run`" in out


def test_a_device_that_stays_hot_ends_with_the_sessions_that_are_done(
    terminal: Terminal, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    hot = Concern("throttling", "the device throttles", stops=True)
    busy = Concern("load", "other programs keep this device busy", stops=False)
    looks = iter([[], [hot], [hot, busy], [busy]])
    monkeypatch.setattr(preflight, "concerns", lambda *_, **__: next(looks, [hot]))
    monkeypatch.setattr(participation, "COOLING_SECONDS", 0.0)

    code, out, _ = terminal.run(counting, "--sessions", "3")

    assert (code, len(counting.sessions)) == (0, 2)
    assert "No further session: the device throttles" in out
    assert "2 of 3 sessions are done." in out
    assert "other programs" not in out


SUSPECT = {"configuration": "best", "state": "suspect", "reason": "slowed down"}


@pytest.mark.parametrize(
    "state",
    [
        {"device": None, "summarised": False},
        {"device": "a-phone", "summarised": True, "sessions": [{"speedups": [SUSPECT]}]},
    ],
)
def test_a_speedup_that_does_not_count_has_no_place(
    state: dict[str, Any], terminal: Terminal, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(result_pages, "SUMMARY_PATIENCE_SECONDS", 0.0)

    code, out, _ = terminal.run(always("/submissions/", Reply(200, state), counting))

    assert (code, "Place " in out) == (0, False)


def test_without_consent_nothing_is_measured_or_sent(
    terminal: Terminal, serve: Serve, counting: Counting
) -> None:
    server = serve(counting)

    code, _, error = terminal("run", "--server", server.url)

    assert (code, terminal.states(), "add --yes" in error) == (2, [], True)
    assert server.paths() == ["GET /api/v1/manifest"]


def test_a_silent_client_never_waits_for_an_answer(
    serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)

    with pytest.raises(UsageError, match="no terminal to ask for agreement"):
        Client(serve(counting).url, home.path).run()


def test_ctrl_c_while_a_session_is_kept_waits_until_it_is(
    terminal: Terminal, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    put = Spool.put

    def disturbed(*arguments: Any) -> Any:
        for number in interrupts.ENDING:
            os.kill(os.getpid(), number)
        return put(*arguments)

    monkeypatch.setattr(Spool, "put", disturbed)

    assert terminal.run(counting)[0] == 0
    assert terminal.states() == ["accepted"]
