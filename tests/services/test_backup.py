"""A backup taken while the server works becomes the same deployment elsewhere, and replaces nothing."""

import gzip
import json
import shutil
import stat
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.builders.documents import submission_document
from tests.services import intake, release
from tests.services.intake import LIMITS
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Services, Serving, command, commands, each, refusal, shell
from tests.waiting import until

EXPORTED_AND_BACKED_UP = """
from django.core.management import call_command
from crowd.results.opendata import exports
exports.create_export()
call_command("backup", {!r})
"""
PUBLIC = ("/api/v1/speedups", "/api/v1/devices", "/api/v1/fronts", "/api/v1/manifest?application=kfusion")


@pytest.fixture(params=["sqlite", "postgresql"])
def pair(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Services, Services]]:
    """The environments of a deployment that works, with the data folder `var`, and of one without data."""
    if request.param == "sqlite":
        intake.prepare(tmp_path / "var", {})
        yield LIMITS, LIMITS
        return
    postgresql: PostgreSQL = request.getfixturevalue("postgresql")
    with (
        intake.prepared_on(postgresql, tmp_path / "var") as here,
        postgresql.database() as elsewhere,
    ):
        yield release.with_tools(postgresql, here), release.with_tools(postgresql, elsewhere)


def seen(server: Serving, token: str) -> list[Any]:
    """What everybody sees of a deployment, and what one participant does."""
    own = server.call("GET", "/api/v1/me/data", Authorization=f"Bearer {token}")
    return [own, *(server.call("GET", path) for path in PUBLIC)]


def test_a_backup_of_a_working_server_is_the_same_deployment_elsewhere(
    tmp_path: Path, pair: tuple[Services, Services]
) -> None:
    here, elsewhere = pair
    var, other, file = tmp_path / "var", tmp_path / "other", tmp_path / "backup.tar.gz"
    with Serving(var, here) as server:
        token = server.enrol()
        server.submit_until_accepted(token, submission_document())
        until(lambda: server.waiting() == 0)
        shell(var, EXPORTED_AND_BACKED_UP.format(str(file)), **here)
        [export] = server.call("GET", "/api/v1/exports")[-1]["results"]
        exported, data = export["created_at"], f"/data/{export['name']}/datapackage.json"
        before = seen(server, token)

    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    done, again = each(other, f"restore {file}", f"restore {file}", **elsewhere)
    assert done.returncode == 0, done.stderr
    assert "is not replaced" in refusal(again)
    with Serving(other, elsewhere) as restored:
        assert seen(restored, token) == before
        document = submission_document()
        assert restored.submit_until_accepted(token, document) == 202
        assert set(intake.runs_of([document])) < set(intake.own_runs(restored, token))

        # The list of releases is in the backup. Their files are copied beside it.
        listed = restored.call("GET", "/api/v1/exports")[-1]["results"]
        assert exported in [export["created_at"] for export in listed if export["release"]]
        assert restored.call("GET", data)[0] == 404
        shutil.copytree(var / "exports", other / "exports", dirs_exist_ok=True)
        assert restored.call("GET", data)[0] == 200


@pytest.fixture(scope="module")
def deployment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an SQLite deployment, which has a published front and its sequence, and its backup."""
    folder = tmp_path_factory.mktemp("deployment")
    intake.prepare(folder / "var", {})
    commands(folder / "var", f"backup {folder / 'backup.tar.gz'}")
    return folder


@pytest.fixture
def backup(deployment: Path, tmp_path: Path) -> Path:
    """A copy of that backup."""
    return Path(shutil.copy(deployment / "backup.tar.gz", tmp_path))


def repacked(backup: Path, **changes: Any) -> Path:
    """The backup with other members in what it says of itself."""
    folder = Path(tempfile.mkdtemp(dir=backup.parent))
    shutil.unpack_archive(backup, folder)
    about = json.loads((folder / "backup.json").read_text())
    (folder / "backup.json").write_text(json.dumps(about | changes))
    changed = folder.with_suffix(".tar.gz")
    with tarfile.open(changed, "w:gz") as archive:
        for file in filter(Path.is_file, folder.rglob("*")):
            archive.add(file, file.relative_to(folder))
    return changed


def with_member(backup: Path, member: tarfile.TarInfo) -> Path:
    """The backup with one more member, without content."""
    changed = Path(tempfile.mkdtemp(dir=backup.parent)) / backup.name
    with gzip.open(backup) as whole:
        changed.with_suffix("").write_bytes(whole.read())
    with tarfile.open(changed.with_suffix(""), "a") as archive:
        archive.addfile(member)
    changed.write_bytes(gzip.compress(changed.with_suffix("").read_bytes()))
    return changed


def test_what_is_no_whole_backup_or_does_not_fit_is_refused(tmp_path: Path, backup: Path) -> None:
    whole = backup.read_bytes()
    cut, text = tmp_path / "cut.tar.gz", tmp_path / "text.tar.gz"
    cut.write_bytes(whole[: len(whole) // 2])
    text.write_text("no archive")
    folder = tarfile.TarInfo("sequences")
    folder.type = tarfile.DIRTYPE
    complaints = {
        cut: "damaged, or not a backup of this software",
        text: "damaged, or not a backup of this software",
        tmp_path / "absent": "damaged, or not a backup of this software",
        repacked(backup, format=3): "format 3",
        repacked(backup, vendor="postgresql"): "holds a postgresql database",
        repacked(backup, migrations={"results": "9999_from_the_future"}): "newer version of this software",
        repacked(backup, files={"database": "0" * 64}): "damaged: database does not match its digest",
        with_member(backup, tarfile.TarInfo("../outside")): "../outside is not a file, or lies outside",
        with_member(backup, folder): "sequences is not a file, or lies outside",
    }

    var = tmp_path / "new"

    refused = each(var, *(f"restore {file}" for file in complaints))

    for done, complaint in zip(refused, complaints.values(), strict=True):
        assert complaint in refusal(done)
    assert not (var / "frontrunner.sqlite3").exists()
    assert list(var.glob(".backup-*")) == []


def test_a_file_that_is_there_is_not_replaced(deployment: Path, backup: Path) -> None:
    before = backup.read_bytes()

    assert "exists already" in refusal(command(deployment / "var", "backup", str(backup)))
    assert backup.read_bytes() == before
    assert list(backup.parent.glob(".backup-*")) == []


def test_without_the_databases_own_program_it_says_what_to_install(
    tmp_path: Path, empty_database: str
) -> None:
    services = {"DATABASE_URL": empty_database, "PATH": str(tmp_path)}

    line = refusal(command(tmp_path / "var", "backup", str(tmp_path / "backup.tar.gz"), **services))

    assert "pg_dump is not installed" in line
    assert "postgresql-client" in line
