"""A filled SQLite server becomes the same server on PostgreSQL, wholly or not at all."""

import shutil
from contextlib import closing
from pathlib import Path

import pytest

from tests.services import release
from tests.services.intake import own_runs
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Serving, command, commands, connect, each, refusal
from tests.services.test_backup import seen

SETTINGS = release.LIMITS | release.RARE_BELOW
TABLES = "SELECT count(*) FROM information_schema.tables WHERE table_schema = 'public'"


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with the filled SQLite database of a release."""
    folder = tmp_path_factory.mktemp("moved") / "var"
    commands(folder, f"restore {release.backup('sqlite')}", "prepare", **SETTINGS)
    return folder


@pytest.fixture
def var(filled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(filled, tmp_path / "var"))


def test_the_moved_server_answers_as_before_and_accepts_more(var: Path, empty_database: str) -> None:
    known, line = release.content("sqlite"), f"move --to {empty_database}"
    with Serving(var, SETTINGS) as server:
        before = seen(server, known["token"])
        assert "end it first" in refusal(command(var, *line.split()))

    done, again = each(var, line, line)

    assert done.returncode == 0, done.stderr
    assert "all counts and digests are equal" in done.stdout
    assert "name an empty one" in refusal(again)
    with Serving(var, SETTINGS | {"DATABASE_URL": empty_database}) as server:
        assert seen(server, known["token"]) == before
        assert own_runs(server, known["token"]) == known["runs"]
        assert server.enrol()  # keys go on behind those that were moved


def test_a_row_that_postgresql_cannot_store_is_named_and_nothing_is_moved(
    var: Path, empty_database: str
) -> None:
    with closing(connect(var, {})) as database:
        database.execute("UPDATE devices_devicemodel SET name = name || char(0)")

    done = command(var, "move", "--to", empty_database)

    assert "cannot store a row of devices_devicemodel" in refusal(done)
    with closing(connect(var, {"DATABASE_URL": empty_database})) as moved:
        assert moved.execute(TABLES).fetchone() == (0,)


def test_only_an_empty_postgresql_that_answers_is_a_target(
    var: Path, tmp_path: Path, empty_database: str, postgresql: PostgreSQL
) -> None:
    unused = empty_database.replace(str(postgresql.port), "1")
    refused = [
        *each(tmp_path / "unprepared", f"move --to {empty_database}"),
        *each(var, f"move --to {unused}", "move --to sqlite:///other.sqlite3"),
        *each(var, f"move --to {empty_database}", DATABASE_URL=empty_database),
    ]

    reasons = ["lacks migrations", "does not answer", "names no PostgreSQL", "not SQLite"]
    for done, reason in zip(refused, reasons, strict=True):
        assert reason in refusal(done)
