"""Backup and restore. A backup is one tar file.

It holds a description (backup.json, with digests), the database, and the sequences added to this server.
SQLite is copied by its backup interface, PostgreSQL by pg_dump: both give a consistent snapshot while the
database is in use. Static files and messages are left out, because they can be made again. Of the open data
it holds the list of releases, not the files. The key that signs sessions and private pages is left out too:
people log in again after a restore. A backup contains digests of tokens and passwords, so only its owner can
read the file.
"""

import hashlib
import json
import os
import shutil
import sqlite3
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from django.conf import settings
from django.db import connection
from django.db.migrations.loader import MigrationLoader
from django.db.migrations.recorder import MigrationRecorder

from crowd.database import damage, sqlite_file
from crowd.database.upgrade import REFUSAL
from crowd.results.models import Export, ExportFile

FORMAT = 2  # 1 was written before 1.0
ABOUT, DATABASE, SEQUENCES = "backup.json", "database", "sequences"
TASK = "backup"  # under this name the time of the last backup is stored
TOOL_REMEDY = "install PostgreSQL's client programs (Debian: postgresql-client) of the server's version"


class BackupError(Exception):
    """A backup cannot be made or restored; the message gives the reason and the remedy."""


@dataclass(frozen=True)
class About:
    """The description of a backup. `migrations`: the last one of each application."""

    format: int
    made_at: str
    vendor: str
    migrations: dict[str, str]
    files: dict[str, str]  # SHA-256 by name


def make(path: Path) -> About:
    """Write a backup to `path`, which appears once it is complete. Needs disk space for the database twice.

    Raises BackupError if `path` exists or the database cannot be copied, and DamagedError if it is damaged.
    """
    if path.exists():
        raise BackupError(f"{path} exists already: name another file")
    with _private_folder(path.absolute().parent) as folder:
        dump = folder / DATABASE
        {"sqlite": _copy_sqlite, "postgresql": _dump_postgresql}[_vendor()](dump)
        members = {DATABASE: dump} | _own_sequences()
        about = About(
            format=FORMAT,
            made_at=datetime.now(UTC).isoformat(timespec="seconds"),
            vendor=connection.vendor,
            migrations=_last_migrations(MigrationRecorder(connection).applied_migrations()),
            files={name: _digest(file) for name, file in members.items()},
        )
        (folder / ABOUT).write_text(json.dumps(asdict(about), indent=2))
        complete = folder / "complete"
        with tarfile.open(complete, "w:gz", compresslevel=1) as archive:
            for name, file in ({ABOUT: folder / ABOUT} | members).items():
                archive.add(file, name)
        _move_into_place(complete, path)
    return about


def restore(path: Path) -> About:
    """Restore the backup at `path` into a server without data. Its tables stay at their migrations.

    Existing data is never replaced. Raises BackupError if the database has tables or is of another kind, or
    if the backup is damaged or comes from a newer version of this software.
    """
    _refuse_unless_empty()
    with _private_folder(Path(settings.FRONTRUNNER_VAR)) as folder:
        try:
            with tarfile.open(path, "r:gz") as archive:
                _extract(archive, folder)
            about = About(**json.loads((folder / ABOUT).read_text()))
        except (OSError, tarfile.TarError, EOFError, ValueError, TypeError) as error:
            raise BackupError(f"{path} is damaged, or not a backup of this software: {error}") from error
        _check(about, folder, path)
        _restore_sequences(folder)
        {"sqlite": _restore_sqlite, "postgresql": _restore_postgresql}[about.vendor](folder / DATABASE)
    _delete_exports()
    return about


@contextmanager
def _private_folder(parent: Path) -> Iterator[Path]:
    """A temporary folder in `parent` that only its owner can read."""
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".backup-", dir=parent) as folder:
        yield Path(folder)


def _extract(archive: tarfile.TarFile, folder: Path) -> None:
    """All files of `archive`. Debian 12's Python 3.11.2 does not have tarfile's own filter yet."""
    for member in archive:
        copy, content = folder / member.name, archive.extractfile(member)
        if content is None or not copy.resolve().is_relative_to(folder.resolve()):
            raise ValueError(f"{member.name} is not a file, or lies outside of the backup")
        copy.parent.mkdir(parents=True, exist_ok=True)
        with content, copy.open("xb") as file:
            shutil.copyfileobj(content, file)


def _move_into_place(complete: Path, path: Path) -> None:
    complete.chmod(0o600)
    with complete.open("rb") as file:
        os.fsync(file.fileno())
    complete.replace(path)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _vendor() -> str:
    if connection.vendor not in {"sqlite", "postgresql"}:
        raise BackupError(
            f"{connection.vendor}: use its own tools; this command copies SQLite and PostgreSQL"
        )
    return connection.vendor


def _last_migrations(migrations: Mapping[tuple[str, str], Any]) -> dict[str, str]:
    """The last migration of each application; their names start with numbers."""
    return dict(sorted(migrations))


def _own_sequences() -> dict[str, Path]:
    folder = Path(settings.FRONTRUNNER_VAR) / SEQUENCES
    return {
        f"{SEQUENCES}/{file.relative_to(folder).as_posix()}": file
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not file.is_symlink()
    }


def _check(about: About, folder: Path, path: Path) -> None:
    if about.format < FORMAT:
        raise BackupError(f"{path} {REFUSAL}")
    if about.format > FORMAT:
        raise BackupError(f"{path} has format {about.format}, this software reads {FORMAT}")
    if about.vendor != _vendor():
        raise BackupError(
            f"{path} holds a {about.vendor} database, DATABASE_URL names a {connection.vendor} one"
        )
    migrations = MigrationLoader(None).disk_migrations
    for application, name in about.migrations.items():
        if (application, name) not in migrations:
            raise BackupError(
                f"{path} was made by a newer version of this software: {application} is at {name}"
            )
    for name, digest in about.files.items():
        file = folder / name
        if not file.is_file() or _digest(file) != digest:
            raise BackupError(f"{path} is damaged: {name} does not match its digest")


def _refuse_unless_empty() -> None:
    if _vendor() == "sqlite":
        database = sqlite_file.path(connection)
        existing = next(
            (file for file in sqlite_file.with_logs(database) if file.exists() and file.stat().st_size), None
        )
        if existing is not None:
            raise BackupError(f"{existing} exists and is not replaced: move it away, or set FRONTRUNNER_VAR")
        return
    if connection.introspection.table_names():
        raise BackupError(
            "the database has tables and is not replaced: name an empty database in DATABASE_URL"
        )


def _restore_sequences(folder: Path) -> None:
    """Existing packs stay, because a pack's name determines its content in every front."""
    target = Path(settings.FRONTRUNNER_VAR) / SEQUENCES
    for pack in sorted((folder / SEQUENCES).glob("*")):
        if not (target / pack.name).exists():
            target.mkdir(exist_ok=True)
            shutil.move(pack, target / pack.name)


def _delete_exports() -> None:
    """Delete the rows of exports that are not releases: the files are not in the backup, and the rows would
    delay new ones.
    """
    exports = Export.objects.filter(release=False, removed_at=None)
    for rows in (ExportFile.objects.filter(export__in=exports.values("pk")), exports):
        rows._raw_delete(rows.db)


def _copy_sqlite(target: Path) -> None:
    source = sqlite_file.path(connection)
    if not source.exists():
        raise BackupError(f"there is no database at {source}")
    with (
        closing(sqlite3.connect(f"file:{source}?mode=rw", uri=True)) as live,
        closing(sqlite3.connect(target)) as copy,
    ):
        live.backup(copy)  # all pages in one step; readers and writers continue
        damage.check_answer(copy.execute("PRAGMA quick_check(1)").fetchone())
        copy.execute("PRAGMA journal_mode=DELETE")  # one file


def _restore_sqlite(source: Path) -> None:
    with closing(sqlite3.connect(source)) as copy:
        (state,) = copy.execute("PRAGMA quick_check").fetchone()
    if state != "ok":
        raise BackupError(f"the database in the backup is damaged: {state}")
    for file in sqlite_file.with_logs(sqlite_file.path(connection)):
        file.unlink(missing_ok=True)  # empty: _refuse_unless_empty made sure
    shutil.move(source, sqlite_file.path(connection))


def _dump_postgresql(target: Path) -> None:
    # The archive around it is compressed.
    _tool("pg_dump", "--format=custom", "--compress=0", "--no-owner", "--no-privileges", f"--file={target}")


def _restore_postgresql(source: Path) -> None:
    # All or nothing.
    _tool("pg_restore", "--no-owner", "--no-privileges", "--single-transaction", str(source))


def _tool(name: str, *options: str) -> None:
    """Run a program of PostgreSQL on the database, with the connection options of `manage.py dbshell`."""
    (_psql, *where, database), secrets = connection.client.settings_to_cmd_args_env(
        connection.settings_dict, []
    )
    try:
        done = subprocess.run(
            [name, *where, f"--dbname={database}", *options],
            env=os.environ | (secrets or {}),
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError:
        raise BackupError(f"{name} is not installed: {TOOL_REMEDY}") from None
    if done.returncode:
        raise BackupError(f"{name} failed: {done.stderr.strip()} (if versions differ: {TOOL_REMEDY})")
