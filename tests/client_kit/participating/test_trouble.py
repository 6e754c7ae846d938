"""What can go wrong with the machine or the server: one line that says what, and the right exit code."""

import errno
import json
import os
import sqlite3
import stat
from typing import Any

import pytest

from client_kit.client import Client
from client_kit.delivery import sending
from client_kit.delivery import spool as spool_module
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.spool import Spool
from client_kit.device import condition
from client_kit.home import Home
from client_kit.participating import participation
from tests.client_kit import canned
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Reply, Request, problem
from tests.client_kit.terminal import Serve, Terminal, canned_measurement, client, counting

__all__ = ["canned_measurement", "client", "counting"]


def full(*_: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_an_error_before_anything_is_measured(
    client: Terminal, serve: Serve, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condition, "free_disk", lambda _: 1000)

    code, out, error = client("run", "--yes", "--server", serve(counting).url)

    assert code == 3
    assert "a session could not be kept" in error
    assert "Order:" not in out


def test_a_disk_that_fills_up_during_the_download_is_an_error(
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
def test_a_home_that_cannot_be_written_is_an_error_with_the_remedy(
    command: str, client: Terminal, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    home.path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    if os.geteuid() == 0:  # whom permissions do not stop
        monkeypatch.setattr("tempfile.TemporaryFile", _read_only)
    arguments = ["--server", "http://127.0.0.1:1"] if command == "run" else []

    code, _, error = client(command, *arguments)

    assert code == 3
    assert str(home.path) in error
    assert "set FRONTRUNNER_HOME to a writable folder" in error


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
    assert "using its manifest from the last visit" in out
    assert [item.state for item in Spool(home.spool).items()] == ["accepted", "queued"]
    assert client("send")[1].endswith("1 still to send.\n")


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (Reply(200, raw=b"<html>Welcome to our hotel"), "the answer is not JSON"),
        (Reply(200, {"hello": "world"}), "the server's manifest lacks 'configurations'"),
        (Reply(404, raw=b"<html>no"), "answers 404 Not Found, unlike a Frontrunner server"),
        (Reply(301, {}, (("Location", "https://other.example/"),)), "redirects to https://other.example/"),
        (problem(404, "not_found", "no front of kfusion is published"), "no front of kfusion is published"),
    ],
)
def test_a_wrong_server_is_an_error_that_says_so(
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
    assert "does not accept measurements now: We move house until Monday." in error
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
    sending.deliver(far, home, clock=lambda: 4e9)
    pauses: list[float] = []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        server.answer = counting

    Client(home=home.path).send(wait=True, pause=pause)

    assert pauses == [1.0]
    assert refusals == []
    assert [item.state for item in Spool(home.spool).items()] == ["accepted"]
    assert len(counting.sessions) == 1


def test_a_missing_module_is_an_error_with_what_to_install(
    client: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: Any) -> None:
        raise ModuleNotFoundError("No module named 'numpy'", name="numpy")

    monkeypatch.setattr(participation, "run", missing)

    code, _, error = client("run", "--server", "http://127.0.0.1:1")

    assert (code, error) == (3, "frontrunner: numpy is not installed here: pip install numpy\n")


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
