"""A filled SQLite server becomes the same server on PostgreSQL, wholly or not at all."""

import sqlite3
from contextlib import closing
from pathlib import Path

import psycopg
import pytest

from tests.services import release
from tests.services.intake import own_runs
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Serving, command
from tests.services.test_backup import refusal, seen

SETTINGS = release.LIMITS | release.RARE_BELOW
TABLES = "SELECT count(*) FROM information_schema.tables WHERE table_schema = 'public'"


@pytest.fixture
def var(tmp_path: Path) -> Path:
    """A data folder with the filled SQLite database of a release."""
    folder = tmp_path / "var"
    done = command(folder, "restore", str(release.backup("sqlite")), **SETTINGS)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def empty(postgresql: PostgreSQL) -> PostgreSQL:
    postgresql.empty()
    return postgresql


def tables(postgresql: PostgreSQL) -> int:
    with psycopg.connect(postgresql.url) as connection:
        (count,) = connection.execute(TABLES).fetchone() or (None,)
    return int(count or 0)


def test_the_moved_server_answers_as_before_and_accepts_more(var: Path, empty: PostgreSQL) -> None:
    known = release.content("sqlite")
    with Serving(var, SETTINGS) as server:
        before = seen(server, known["token"])
        assert "end it first" in refusal(var, "move", "--to", empty.url)

    done = command(var, "move", "--to", empty.url)

    assert done.returncode == 0, done.stderr
    assert "all counts and digests are equal" in done.stdout
    assert "name an empty one" in refusal(var, "move", "--to", empty.url)
    with Serving(var, SETTINGS | {"DATABASE_URL": empty.url}) as server:
        assert seen(server, known["token"]) == before
        assert own_runs(server, known["token"]) == known["runs"]
        assert server.enrol()  # keys go on behind those that were moved


def test_a_row_that_postgresql_cannot_store_is_named_and_nothing_is_moved(
    var: Path, empty: PostgreSQL
) -> None:
    with closing(sqlite3.connect(var / "frontrunner.sqlite3")) as database, database:
        database.execute("UPDATE devices_devicemodel SET name = name || char(0)")

    assert "cannot store a row of devices_devicemodel" in refusal(var, "move", "--to", empty.url)
    assert tables(empty) == 0


def test_only_an_empty_postgresql_that_answers_is_a_target(tmp_path: Path, empty: PostgreSQL) -> None:
    var = tmp_path / "var"
    assert "lacks migrations" in refusal(var, "move", "--to", empty.url)
    command(var, "migrate")
    unused = empty.url.replace(str(empty.port), "1")
    assert "does not answer" in refusal(var, "move", "--to", unused)
    assert "names no PostgreSQL" in refusal(var, "move", "--to", "sqlite:///other.sqlite3")
    assert "not SQLite" in refusal(var, "move", "--to", empty.url, DATABASE_URL=empty.url)
