"""A filled server of release 1.0 becomes one of this version, and of the next one: wholly or not at all."""

import json
import tarfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from crowd.database.upgrade import REFUSAL
from tests.builders.documents import front_document, session_document, submission_document
from tests.services import intake, release
from tests.services.intake import LIMITS
from tests.services.postgresql import PostgreSQL
from tests.services.program import free_port
from tests.services.serving import Services, Serving, command, commands, connect, refusal, shell
from tests.services.test_backup import seen
from tests.waiting import until

OLDER = """
CREATE TABLE django_migrations (id integer PRIMARY KEY, app text, name text, applied timestamp);
INSERT INTO django_migrations VALUES (1, 'results', '0001_initial', '2026-11-20')
"""
NEXT = {"DJANGO_SETTINGS_MODULE": "tests.services.next_release"}
# Upgrades in child processes that are killed within a migration. The models are those of release 1.0.
KILLED = """
import os
import signal
from django.core.management import call_command
from django.db import connection, connections
from django.db.migrations.recorder import MigrationRecorder
from crowd.operations import move

def content():
    return MigrationRecorder(connection).applied_migrations().keys(), move.contents("default")

before = content()
for application in ("devices", "results"):
    connections.close_all()
    child = os.fork()
    if not child:
        os.environ["KILL_AT"] = application
        call_command("migrate", verbosity=0)
        os._exit(0)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL, application
    assert content() == before, application
"""
TABLES = {
    "sqlite": "SELECT name FROM sqlite_master WHERE type = 'table'",
    "postgresql": "SELECT table_name FROM information_schema.tables WHERE table_schema = 'public'",
}
DATABASES = ["sqlite", "postgresql"]


@contextmanager
def environment(database: str, request: pytest.FixtureRequest) -> Iterator[Services]:
    """Environment of a server with `database`, without tables."""
    if database == "sqlite":
        yield LIMITS | release.RARE_BELOW
        return
    postgresql: PostgreSQL = request.getfixturevalue("postgresql")
    with postgresql.database() as url:
        yield release.with_tools(postgresql, url) | release.RARE_BELOW


@pytest.fixture(scope="module", params=DATABASES)
def database(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def services(database: str, request: pytest.FixtureRequest) -> Iterator[Services]:
    """Environment of the server of release 1.0."""
    with environment(database, request) as found:
        yield found


@pytest.fixture(scope="module")
def var(tmp_path_factory: pytest.TempPathFactory, database: str, services: Services) -> Path:
    """Its data folder, which is filled."""
    var = tmp_path_factory.mktemp(database) / "var"
    commands(var, f"restore {release.backup(database)}", **services)
    return var


@pytest.fixture(scope="module")
def server(var: Path, services: Services) -> Iterator[Serving]:
    """A server of this version with that folder."""
    with Serving(var, services) as running:
        yield running


def test_an_upgrade_that_is_killed_changes_nothing(var: Path, services: Services) -> None:
    shell(var, KILLED, **services, **NEXT)


def test_a_filled_server_of_release_1_0_is_brought_up_to_date(server: Serving, database: str) -> None:
    known = release.content(database)

    assert until(lambda: server.waiting() == 0)
    assert intake.own_runs(server, known["token"]) == known["runs"]
    _, data = server.call("GET", "/api/v1/me/data", Authorization=f"Bearer {known['token']}")
    means = {
        run["configuration"]: sum(run["frame_us"]) / len(run["frame_us"])
        for session in data["sessions"]
        for run in session["runs"]
    }
    measured = means["default"] / means["best"]
    assert measured == pytest.approx(release.DEFAULT_US / release.BEST_US, rel=0.1)
    assert server.call("GET", "/api/v1/me", Authorization=f"Bearer {known['erased']}")[0] == 401
    _, answer = server.call("GET", "/api/v1/speedups")
    (row,) = answer["results"]
    assert row["speedup"] == pytest.approx(release.DEFAULT_US / release.BEST_US, rel=0.1)
    # The alias's session belongs to the model. That of the rare model is quarantined.
    assert (row["sessions"], row["installations"]) == (release.SESSIONS + 2, 3)
    assert not any(
        "pixel-7" in device["slug"] for device in server.call("GET", "/api/v1/devices")[1]["results"]
    )
    _, answer = server.call("GET", "/api/v1/explorations")
    (exploration,) = [each for each in answer["results"] if each["measured_elsewhere"] is None]
    counts = exploration["evaluations"]
    assert counts["done"] + counts["failed"] == release.MEASURED
    assert "kfusion-test" in intake.text_of(server, "/fronts/kfusion-test/")

    path = server.var / "front.json"
    pack = next(server.var.glob("sequences/*/pack.json"))
    path.write_text(json.dumps(front_document(json.loads(pack.read_text()), "next")))
    commands(server.var, f"front publish {path} --yes", **server.services)
    session = session_document("kfusion-next")
    assert server.submit_until_accepted(known["token"], submission_document(session)) == 202
    assert until(lambda: server.waiting() == 0)
    _, answer = server.call("GET", "/api/v1/speedups?front=kfusion-next")
    assert answer["results"][0]["sessions"] == 1


def test_the_next_upgrade_loses_nothing(server: Serving, database: str) -> None:
    var, services, token = server.var, server.services, release.content(database)["token"]
    answers = seen(server, token)
    server.__exit__()

    commands(var, "migrate", **services, **NEXT)

    with Serving(var, services | NEXT) as upgraded:
        assert seen(upgraded, token) == answers


def test_sqlite_is_upgraded_only_while_nobody_else_uses_it(tmp_path: Path) -> None:
    intake.prepare(tmp_path, {})
    with closing(connect(tmp_path, {})) as other:
        other.execute("SELECT count(*) FROM devices_devicemodel").fetchone()
        done = command(tmp_path, "migrate", **NEXT)

    assert "stop web servers and workers" in refusal(done)


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        *[("sqlite", "prepare"), ("sqlite", "serve"), ("postgresql", "migrate")],
        pytest.param("sqlite", "migrate", marks=pytest.mark.exhaustive),
        pytest.param("postgresql", "prepare", marks=pytest.mark.exhaustive),
        pytest.param("postgresql", "serve", marks=pytest.mark.exhaustive),
    ],
)
def test_a_database_that_is_older_is_refused_and_stays_as_it_is(
    tmp_path: Path, request: pytest.FixtureRequest, kind: str, line: str
) -> None:
    with environment(kind, request) as services, closing(connect(tmp_path, services)) as older:
        for statement in OLDER.split(";"):
            older.execute(statement)

        done = command(tmp_path, line, **services, FRONTRUNNER_PORT=str(free_port()))

        assert done.returncode == 1
        assert REFUSAL in done.stderr.strip().splitlines()[-1]
        assert older.execute(TABLES[kind]).fetchall() == [("django_migrations",)]


@pytest.mark.parametrize("kind", DATABASES)
def test_a_backup_that_is_older_is_refused(tmp_path: Path, request: pytest.FixtureRequest, kind: str) -> None:
    about = {"format": 1, "made_at": "2026-11-20", "vendor": kind, "migrations": {}, "files": {}}
    (tmp_path / "backup.json").write_text(json.dumps(about))
    file, var = tmp_path / "backup.tar.gz", tmp_path / "var"
    with tarfile.open(file, "w:gz") as archive:
        archive.add(tmp_path / "backup.json", "backup.json")

    with environment(kind, request) as services:
        done = command(var, "restore", str(file), **services)

        assert refusal(done) == f"frontrunner: {file} {REFUSAL}"
        with closing(connect(var, services)) as database:
            assert database.execute(TABLES[kind]).fetchall() == []
