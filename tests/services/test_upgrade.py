"""A filled server of release 1.0 becomes one of this version, and of the next one: wholly or not at all."""

import json
import sqlite3
import tarfile
from contextlib import closing
from pathlib import Path

import pytest

from crowd.database.upgrade import REFUSAL
from tests.builders.documents import front_document, session_document, submission_document
from tests.services import intake, release
from tests.services.intake import LIMITS
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Services, Serving, command, commands, shell
from tests.services.test_backup import seen
from tests.waiting import until

OLDER = """
from django.db import connection
from django.db.migrations.recorder import MigrationRecorder
MigrationRecorder(connection).record_applied("results", "0001_initial")
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
TABLES = "from django.db import connection; print(connection.introspection.table_names())"


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def services(database: str, request: pytest.FixtureRequest) -> Services:
    """Environment of the database, without tables."""
    if database == "sqlite":
        return LIMITS | release.RARE_BELOW
    postgresql: PostgreSQL = request.getfixturevalue("postgresql")
    postgresql.empty()
    return release.with_tools(postgresql) | release.RARE_BELOW


@pytest.fixture
def var(tmp_path: Path, database: str, services: Services) -> Path:
    """A data folder of the filled server of release 1.0."""
    done = command(tmp_path / "var", "restore", str(release.backup(database)), **services)
    assert done.returncode == 0, done.stderr
    return tmp_path / "var"


def test_a_filled_server_of_release_1_0_is_brought_up_to_date(
    var: Path, database: str, services: Services
) -> None:
    known = release.content(database)

    with Serving(var, services) as server:
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

        path = var / "front.json"
        pack = next(var.glob("sequences/*/pack.json"))
        path.write_text(json.dumps(front_document(json.loads(pack.read_text()), "next")))
        commands(var, f"front publish {path} --yes", **services)
        session = session_document("kfusion-next")
        assert server.submit_until_accepted(known["token"], submission_document(session)) == 202
        assert until(lambda: server.waiting() == 0)
        _, answer = server.call("GET", "/api/v1/speedups?front=kfusion-next")
        assert answer["results"][0]["sessions"] == 1


def test_an_upgrade_that_is_killed_changes_nothing_and_a_whole_one_loses_nothing(
    var: Path, database: str, services: Services
) -> None:
    token = release.content(database)["token"]
    shell(var, KILLED, **services, **NEXT)
    with Serving(var, services) as server:
        answers = seen(server, token)

    done = command(var, "migrate", **services, **NEXT)

    assert done.returncode == 0, done.stderr
    with Serving(var, services | NEXT) as server:
        assert seen(server, token) == answers


def test_sqlite_is_upgraded_only_while_nobody_else_uses_it(tmp_path: Path) -> None:
    command(tmp_path, "migrate")
    with closing(sqlite3.connect(tmp_path / "frontrunner.sqlite3")) as other:
        other.execute("SELECT count(*) FROM devices_devicemodel").fetchone()
        done = command(tmp_path, "migrate", **NEXT)

    assert done.returncode == 1
    assert "stop web servers and workers" in done.stderr


def test_a_database_that_is_older_is_refused_and_stays_as_it_is(tmp_path: Path, services: Services) -> None:
    shell(tmp_path, OLDER, **services)
    before = shell(tmp_path, TABLES, **services)

    for line in ("migrate", "prepare", "serve"):
        done = command(tmp_path, line, **services)
        assert done.returncode == 1
        assert REFUSAL in done.stderr.strip().splitlines()[-1]

    assert shell(tmp_path, TABLES, **services) == before == "['django_migrations']\n"


def test_a_backup_that_is_older_is_refused(tmp_path: Path, database: str, services: Services) -> None:
    about = {"format": 1, "made_at": "2026-11-20", "vendor": database, "migrations": {}, "files": {}}
    (tmp_path / "backup.json").write_text(json.dumps(about))
    file = tmp_path / "backup.tar.gz"
    with tarfile.open(file, "w:gz") as archive:
        archive.add(tmp_path / "backup.json", "backup.json")

    done = command(tmp_path / "var", "restore", str(file), **services)

    assert (done.returncode, done.stderr.strip()) == (1, f"frontrunner: {file} {REFUSAL}")
    assert shell(tmp_path / "var", TABLES, **services) == "[]\n"
