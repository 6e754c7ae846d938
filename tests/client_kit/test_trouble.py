"""What can go wrong with the machine or the server: one line that says what, and the right exit code."""

import errno
import gzip
import json
import os
import signal
import sqlite3
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit import (
    condition,
    delivery,
    enrolment,
    interrupts,
    measurement,
    participation,
    preflight,
)
from client_kit import spool as spool_module
from client_kit.client import Client
from client_kit.errors import UsageError
from client_kit.home import Home
from client_kit.manifest import Manifest
from client_kit.preflight import Concern
from client_kit.session import Session
from client_kit.spool import Spool
from tests.client_kit import canned, documents
from tests.client_kit.counting import Counting
from tests.client_kit.killed import DEVICE, IDENTITY
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem

Serve = Callable[..., ScriptedServer]
CHUNKS = (b"header", b"frames")


@pytest.fixture
def counting(tmp_path: Path) -> Counting:
    for chunk in CHUNKS:
        (tmp_path / documents.digest(chunk)).write_bytes(chunk)
    return Counting(documents.manifest(CHUNKS), tmp_path)


@pytest.fixture(autouse=True)
def canned_measurement(monkeypatch: pytest.MonkeyPatch, home: Home) -> None:
    """A machine that always measures the same, with the home folder of the test."""
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))
    monkeypatch.setattr(measurement, "measure", lambda _, asked, plan, **__: canned.measured(asked, plan))
    monkeypatch.setattr(participation, "_device", lambda *_: (DEVICE, IDENTITY))


class Terminal:
    """The command line in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str) -> tuple[int, str, str]:
        """Exit code, standard output and error; AssertionError where an error is not one line."""
        code = command_line.main(arguments)
        told = self._capsys.readouterr()
        assert len(told.err.splitlines()) == (1 if code else 0), told.err
        return code, told.out, told.err


@pytest.fixture
def client(capsys: pytest.CaptureFixture[str]) -> Terminal:
    return Terminal(capsys)


def full(*_: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_disk_that_is_full_before_is_told_before_anything_is_measured(
    client: Terminal, serve: Serve, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condition, "free_disk", lambda _: 1000)

    code, out, error = client("run", "--yes", "--server", serve(counting).url)

    assert code == 3
    assert "a session could not be kept" in error
    assert "Order:" not in out


def test_a_disk_that_fills_up_while_the_sequence_comes_is_told(
    client: Terminal, serve: Serve, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = serve(counting)
    counting_write = os.fsync
    writes: list[int] = []

    def fsync(descriptor: int) -> None:
        writes.append(descriptor)
        if len(writes) > 2:  # the manifest and the consent; then the first chunk
            full()
        counting_write(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)

    code, _, error = client("run", "--yes", "--server", server.url)

    assert code == 3
    assert "cannot be written: No space left on device" in error


def test_a_spool_without_room_says_so(
    client: Terminal, serve: Serve, counting: Counting, monkeypatch: pytest.MonkeyPatch, home: Home
) -> None:
    real = sqlite3.connect

    def small(*arguments: Any, **options: Any) -> sqlite3.Connection:
        connection = real(*arguments, **options)
        connection.execute("PRAGMA max_page_count = 3")
        return connection

    Spool(home.spool)
    monkeypatch.setattr(spool_module.sqlite3, "connect", small)

    code, _, error = client("run", "--yes", "--sessions", "9", "--server", serve(counting).url)

    assert code == 3
    assert "spool.sqlite3 cannot be used: database or disk is full" in error
    kept = [item.state for item in Spool(home.spool).items()]
    assert kept == ["accepted"] * len(counting.sessions)


@pytest.mark.skipif(os.name == "nt", reason="permissions of another kind")
@pytest.mark.parametrize("command", ["run", "status", "send", "export", "erase", "choose", "doctor"])
def test_a_home_that_cannot_be_written_is_told_with_the_remedy(
    command: str, client: Terminal, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    home.path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    if os.geteuid() == 0:  # whom permissions do not stop
        monkeypatch.setattr("tempfile.TemporaryFile", _read_only)
    arguments = ["--server", "http://127.0.0.1:1"] if command == "run" else []

    code, _, error = client(command, *arguments)

    assert code == 3
    assert str(home.path) in error
    assert "set FRONTRUNNER_HOME to a folder that can be written" in error


def _read_only(**_: Any) -> None:
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


def test_a_lock_that_is_no_database_is_named(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    (home.path / "delivery.lock").write_bytes(b"no database at all " * 100)

    code, _, error = client("send")

    assert code == 3
    assert "delivery.lock cannot be used: file is not a database" in error


def test_without_a_network_there_is_one_line_and_what_was_measured_stays(
    client: Terminal, serve: Serve, counting: Counting, closed_port: int, home: Home
) -> None:
    address = f"http://127.0.0.1:{closed_port}"
    code, _, error = client("run", "--yes", "--server", address)
    assert (code, "Connection refused" in error) == (3, True)

    known = serve(counting, closed_port)
    assert client("run", "--yes", "--server", address)[0] == 0
    known.close()
    code, out, _ = client("run", "--server", address)

    assert code == 0
    assert "measuring what it asked for at the last visit" in out
    assert [item.state for item in Spool(home.spool).items()] == ["accepted", "queued"]
    assert client("send")[1].endswith("1 still to send.\n")


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (Reply(200, raw=b"<html>Welcome to our hotel"), "the answer is not JSON"),
        (Reply(200, {"hello": "world"}), "the server's manifest lacks 'configurations'"),
        (Reply(404, raw=b"<html>no"), "answers 404 Not Found, not as a Frontrunner server does"),
        (Reply(301, {}, (("Location", "https://other.example/"),)), "points to https://other.example/"),
        (problem(404, "not_found", "no front of kfusion is published"), "no front of kfusion is published"),
    ],
)
def test_the_wrong_server_is_told_from_a_right_one(
    reply: Reply, words: str, client: Terminal, serve: Serve
) -> None:
    code, _, error = client("run", "--yes", "--server", serve(lambda _: reply).url)

    assert code == 3
    assert words in error


def test_a_server_that_pauses_takes_nothing_and_says_why(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    counting.manifest |= {"accepting": False, "message": "We move house until Monday."}

    code, _, error = client("run", "--yes", "--server", serve(counting).url)

    assert code == 3
    assert "takes no measurements at present: We move house until Monday." in error
    assert Spool(home.spool).items() == []


def test_a_pause_while_something_waits_keeps_it_until_the_server_takes_it(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    def paused(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            return problem(503, "not_accepting", "back on Monday", Retry_After="3600")
        return counting(request)

    server = serve(paused)
    code, out, _ = client("run", "--yes", "--server", server.url)
    assert (code, "back on Monday (not_accepting)" in out) == (0, True)

    status = client("status")[1]

    assert "queued" in status
    assert "s, as the server asks" in status


def test_a_clock_that_jumps_neither_loses_nor_delays(
    serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusals = [problem(503, "busy"), problem(503, "busy", Retry_After="0")]

    def busy(request: Request) -> Reply:
        return refusals.pop(0) if request.path.endswith("/submissions") else counting(request)

    server = serve(busy)
    asked = Manifest.parse(counting.manifest)
    far = Spool(home.spool, clock=lambda: 4e9, jitter=lambda: 1.0)  # the clock was in the year 2096
    far.put(server.url, canned.payload(asked))
    delivery.deliver(far, home, clock=lambda: 4e9)
    pauses: list[float] = []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        server.answer = counting

    Client(home=home.path).send(wait=True, pause=pause)

    assert pauses == [1.0]
    assert refusals == []
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"]
    assert len(counting.sessions) == 1


def test_ctrl_c_keeps_what_is_finished_for_the_next_send(
    client: Terminal, serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: Any, asked: Any, plan: tuple[str, ...], **__: Any) -> Session:
        whole = canned.measured(asked, plan)
        return Session(whole.id, whole.started_at, whole.backend, whole.runs[:3], (), interrupted=True)

    monkeypatch.setattr(measurement, "measure", interrupted)
    server = serve(counting)

    code, out, error = client("run", "--yes", "--sessions", "3", "--server", server.url)

    assert code == 130
    assert "Stopped: the 3 finished runs are kept." in out
    assert "go with the next `send`" in error
    assert client("send")[0] == 0
    [session] = counting.sessions.values()
    assert [run["configuration"] for run in session["runs"]] == ["default", "best", "best"]


def test_a_front_of_forty_points_is_measured_in_sessions_that_are_each_taken(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    counting.manifest["configurations"] += [
        {"name": f"point-{number}", "parameters": {}, "predicted": {}} for number in range(37)
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


def test_the_place_and_the_page_are_told_after_sending(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    server = serve(counting)

    _, out, _ = client("run", "--yes", "--server", server.url)

    assert "Mean time a frame, by stage" in out
    assert "Place 1 of 2 devices by speedup" in out
    assert f"Among the others: {server.url}/devices/a-phone/" in out
    assert f"whoever has the link may read it): {server.url}/mine/signed/" in out


def test_a_crowd_that_cannot_be_asked_for_spoils_nothing(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    def shy(request: Request) -> Reply:
        return Reply(200, {"results": 7}) if "/speedups" in request.path else counting(request)

    code, out, _ = client("run", "--yes", "--server", serve(shy).url)

    assert code == 0
    assert "The place in the crowd could not be asked for" in out
    assert "Among the others: " in out


def test_a_module_that_is_missing_is_told_with_what_to_install(
    client: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: Any) -> None:
        raise ModuleNotFoundError("No module named 'numpy'", name="numpy")

    monkeypatch.setattr(participation, "run", missing)

    code, _, error = client("run", "--server", "http://127.0.0.1:1")

    assert (code, error) == (3, "frontrunner: numpy is not installed here: pip install numpy\n")


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
    assert (counting.sessions, enrolment.known(home), Spool(home.spool).items()) == ({}, [], [])


def test_a_new_consent_text_is_asked_for_and_what_waits_goes_with_it(
    client: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    def strict(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            told = json.loads(gzip.decompress(request.body))["consent_version"]
            if told != counting.manifest["consent_version"]:
                return problem(400, "consent_outdated", "the text is another one")
        return counting(request)

    asked = Manifest.parse(counting.manifest)
    counting.manifest["consent_version"] = 2
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
    monkeypatch.setattr(preflight, "concerns", lambda *_: next(looks, [hot]))
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
    monkeypatch.setattr(participation, "SUMMARY_PATIENCE_SECONDS", 0.0)

    def answer(request: Request) -> Reply:
        return Reply(200, state) if "/submissions/" in request.path else counting(request)

    code, out, _ = client("run", "--yes", "--server", serve(answer).url)

    assert code == 0
    assert "Place " not in out


def test_a_silent_client_never_waits_for_an_answer(
    serve: Serve, counting: Counting, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)

    with pytest.raises(UsageError, match="nobody is here to agree"):
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


def test_a_server_that_refuses_this_version_spoils_no_export(
    client: Terminal, serve: Serve, counting: Counting
) -> None:
    def refusing(request: Request) -> Reply:
        return problem(426, "client_too_old", "2.0") if "/me/" in request.path else counting(request)

    server = serve(refusing)
    client("run", "--yes", "--server", server.url)

    code, out, _ = client("export")

    assert code == 0
    assert "too old" in json.loads(out)["servers"][server.url]["unavailable"]


def test_a_library_that_does_not_load_is_named(client: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise ImportError("libopenblas.so.0: cannot open", name="numpy._core")

    monkeypatch.setattr(participation, "run", broken)

    code, _, error = client("run", "--server", "http://127.0.0.1:1")

    assert code == 3
    assert error.startswith("frontrunner: numpy does not load here (libopenblas.so.0: cannot open): ")
