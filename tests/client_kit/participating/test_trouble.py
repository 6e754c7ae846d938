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
from tests.client_kit.commands import Terminal
from tests.client_kit.counting import Counting
from tests.client_kit.scripted import Reply, Serve, always, at_first, problem

pytestmark = pytest.mark.usefixtures("canned_measurement")


def test_a_full_disk_is_an_error_before_anything_is_measured(
    terminal: Terminal, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condition, "free_disk", lambda _: 1000)

    code, out, error = terminal.run(counting)

    assert code == 3
    assert "a session could not be kept" in error
    assert "Order:" not in out


def test_a_disk_that_fills_up_during_the_download_is_an_error(
    terminal: Terminal, counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.fsync
    writes: list[int] = []

    def fsync(descriptor: int) -> None:
        writes.append(descriptor)
        if len(writes) > 2:  # the manifest and the consent; then the first chunk
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)

    code, _, error = terminal.run(counting)

    assert code == 3
    assert "cannot be written: No space left on device" in error


def test_a_spool_without_room_says_so(
    terminal: Terminal, counting: Counting, spool: Spool, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = sqlite3.connect

    def small(*arguments: Any, **options: Any) -> sqlite3.Connection:
        connection = real(*arguments, **options)
        connection.execute("PRAGMA max_page_count = 3")
        return connection

    monkeypatch.setattr(spool_module.sqlite3, "connect", small)

    code, _, error = terminal.run(counting, "--sessions", "9")

    assert code == 3
    assert "spool.sqlite3 cannot be used: database or disk is full" in error
    assert terminal.states() == ["accepted"] * len(counting.sessions)


@pytest.mark.skipif(os.name == "nt", reason="permissions of another kind")
@pytest.mark.parametrize("command", ["run", "status", "send", "export", "erase", "choose", "doctor"])
def test_a_home_that_cannot_be_written_is_an_error_with_the_remedy(
    command: str, terminal: Terminal, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(**_: Any) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    home.path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    if os.geteuid() == 0:  # whom permissions do not stop
        monkeypatch.setattr("tempfile.TemporaryFile", read_only)

    code, _, error = terminal(command, *(["--server", "http://127.0.0.1:1"] if command == "run" else []))

    assert code == 3
    assert str(home.path) in error
    assert "set FRONTRUNNER_HOME to a writable folder" in error


def test_a_lock_that_is_not_a_database_is_named(terminal: Terminal, home: Home) -> None:
    (home.path / "delivery.lock").write_bytes(b"no database at all " * 100)

    code, _, error = terminal("send")

    assert code == 3
    assert "delivery.lock cannot be used: file is not a database" in error


def test_without_a_network_there_is_one_line_and_what_was_measured_stays(
    terminal: Terminal, counting: Counting, closed_port: int
) -> None:
    address = f"http://127.0.0.1:{closed_port}"
    code, _, error = terminal("run", "--yes", "--server", address)
    assert (code, "Connection refused" in error) == (3, True)

    assert terminal.run(counting, port=closed_port)[0] == 0
    terminal.server.close()
    code, out, _ = terminal("run", "--server", address)

    assert (code, terminal.states()) == (0, ["accepted", "queued"])
    assert "using its manifest from the last visit" in out
    assert terminal("send")[1].endswith("1 still to send.\n")


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (Reply(200, raw=b"<html>Welcome to our hotel"), "the answer is not JSON"),
        (Reply(200, {"hello": "world"}), "Object missing required field `protocol`"),
        (Reply(404, raw=b"<html>no"), "answers 404 Not Found, unlike a Frontrunner server"),
        (Reply(301, {}, (("Location", "https://other.example/"),)), "redirects to https://other.example/"),
        (problem(404, "not_found", "no front of kfusion is published"), "no front of kfusion is published"),
    ],
)
def test_a_wrong_server_is_an_error_that_says_so(reply: Reply, words: str, terminal: Terminal) -> None:
    code, _, error = terminal.run(lambda _: reply)

    assert (code, words in error) == (3, True), error


def test_a_server_that_pauses_takes_nothing_and_says_why(terminal: Terminal, counting: Counting) -> None:
    counting.manifest |= {"accepting": False, "message": "We move house until Monday."}

    code, _, error = terminal.run(counting)

    assert (code, terminal.states()) == (3, [])
    assert "does not accept measurements now: We move house until Monday." in error


def test_a_pause_while_something_waits_keeps_it_until_the_server_takes_it(
    terminal: Terminal, counting: Counting
) -> None:
    paused = problem(503, "not_accepting", "back on Monday", Retry_After="3600")

    code, out, _ = terminal.run(always("/submissions", paused, counting))

    assert (code, "back on Monday (not_accepting)" in out) == (0, True)
    status = terminal("status")[1]
    assert "queued" in status
    assert "s, as the server asks" in status


def test_a_clock_that_jumps_neither_loses_nor_delays(
    terminal: Terminal, serve: Serve, counting: Counting, home: Home
) -> None:
    refusals = [problem(503, "busy"), problem(503, "busy", Retry_After="0")]
    server = serve(at_first("/submissions", *refusals, then=counting))
    far = Spool(home.spool, clock=lambda: 4e9, jitter=lambda: 1.0)  # the clock was in the year 2096
    far.put(server.url, canned.payload(Manifest.parse(counting.manifest)))
    sending.deliver(far, home, clock=lambda: 4e9)
    pauses: list[float] = []

    Client(home=home.path).send(wait=True, pause=pauses.append)

    assert pauses == [1.0]
    assert len(server.submissions()) == 3
    assert terminal.states() == ["accepted"]
    assert len(counting.sessions) == 1


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        (
            ModuleNotFoundError("No module named 'numpy'", name="numpy"),
            "numpy is not installed here: pip install numpy\n",
        ),
        (
            ImportError("libopenblas.so.0: cannot open", name="numpy._core"),
            "numpy does not load here (libopenblas.so.0: cannot open): ",
        ),
    ],
)
def test_a_module_that_is_missing_or_does_not_load_is_named(
    missing: ImportError, words: str, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def importing(*_: Any) -> None:
        raise missing

    monkeypatch.setattr(participation, "run", importing)

    code, _, error = terminal("run", "--server", "http://127.0.0.1:1")

    assert (code, error.startswith(f"frontrunner: {words}")) == (3, True), error


def test_a_server_that_refuses_this_version_spoils_no_export(terminal: Terminal, counting: Counting) -> None:
    terminal.run(always("/me/", problem(426, "client_too_old", "2.0"), counting))

    code, out, _ = terminal("export")

    assert code == 0
    assert "too old" in json.loads(out)["servers"][terminal.server.url]["unavailable"]
