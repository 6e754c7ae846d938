"""A backup is one tar file: what it is (backup.json, with digests), the database, sequences of one's own.

SQLite is copied by its backup interface, PostgreSQL by pg_dump: both see one moment of a database that goes
on working. Left out is what can be made anew (open data, static files, messages) and the key that signs
sessions and own pages: people log in again after a restore. A backup holds what the database holds, the
digests of tokens and passwords too: its file is for its owner alone.
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

from crowd.results.models import Export, ExportFile

FORMAT = 1
ABOUT, DATABASE, SEQUENCES = "backup.json", "database", "sequences"
TASK = "backup"  # the name under which its last time is kept
TOOL_REMEDY = "install PostgreSQL's client programs (Debian: postgresql-client) of the server's version"


class BackupError(Exception):
    """A backup that cannot be made or restored; the message says why and what would help."""


@dataclass(frozen=True)
class About:
    """What a backup says of itself. `migrations`: the last one of each application."""

    format: int
    made_at: str
    vendor: str
    migrations: dict[str, str]
    files: dict[str, str]  # SHA-256 by name


def make(path: Path) -> About:
    """Write a backup to PATH, which appears once it is whole. Needs room for the database twice.

    Raises BackupError where PATH is there already or the database cannot be copied.
    """
    if path.exists():
        raise BackupError(f"{path} is there already: name another file")
    with _workshop(path.absolute().parent) as folder:
        dump = folder / DATABASE
        {"sqlite": _copy_sqlite, "postgresql": _dump_postgresql}[_vendor()](dump)
        members = {DATABASE: dump} | _own_sequences()
        about = About(
            format=FORMAT,
            made_at=datetime.now(UTC).isoformat(timespec="seconds"),
            vendor=connection.vendor,
            migrations=_last(MigrationRecorder(connection).applied_migrations()),
            files={name: _digest(file) for name, file in members.items()},
        )
        (folder / ABOUT).write_text(json.dumps(asdict(about), indent=2))
        whole = folder / "whole"
        with tarfile.open(whole, "w:gz", compresslevel=1) as archive:
            for name, file in ({ABOUT: folder / ABOUT} | members).items():
                archive.add(file, name)
        _keep(whole, path)
    return about


def restore(path: Path) -> About:
    """Put what the backup at PATH holds into a deployment without data; its tables stay at their migrations.

    Nothing that is there is replaced: BackupError for a database that holds tables, another kind of
    database, a damaged backup, or one of a newer version of this software.
    """
    _refuse_unless_empty()
    with _workshop(Path(settings.FRONTRUNNER_VAR)) as folder:
        try:
            with tarfile.open(path, "r:gz") as archive:
                archive.extractall(folder, filter="data")
            about = About(**json.loads((folder / ABOUT).read_text()))
        except (OSError, tarfile.TarError, EOFError, ValueError, TypeError) as error:
            raise BackupError(f"{path} is no backup of this software, or damaged: {error}") from error
        _check(about, folder, path)
        _put_sequences(folder)
        {"sqlite": _place_sqlite, "postgresql": _load_postgresql}[about.vendor](folder / DATABASE)
    _end_exports()
    return about


@contextmanager
def _workshop(parent: Path) -> Iterator[Path]:
    """A folder beside the result, for its owner alone, gone at the end."""
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".backup-", dir=parent) as folder:
        yield Path(folder)


def _keep(whole: Path, path: Path) -> None:
    whole.chmod(0o600)
    with whole.open("rb") as file:
        os.fsync(file.fileno())
    whole.replace(path)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _vendor() -> str:
    if connection.vendor not in {"sqlite", "postgresql"}:
        raise BackupError(f"{connection.vendor} has tools of its own: this copies SQLite and PostgreSQL")
    return connection.vendor


def _last(migrations: Mapping[tuple[str, str], Any]) -> dict[str, str]:
    """The last of each application's migrations: they are numbered."""
    return dict(sorted(migrations))


def _own_sequences() -> dict[str, Path]:
    folder = Path(settings.FRONTRUNNER_VAR) / SEQUENCES
    return {
        f"{SEQUENCES}/{file.relative_to(folder).as_posix()}": file
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not file.is_symlink()
    }


def _check(about: About, folder: Path, path: Path) -> None:
    if about.format != FORMAT:
        raise BackupError(f"{path} has format {about.format}, this software reads {FORMAT}")
    if about.vendor != _vendor():
        raise BackupError(
            f"{path} holds a {about.vendor} database, DATABASE_URL names a {connection.vendor} one"
        )
    known = MigrationLoader(None).disk_migrations
    for application, name in about.migrations.items():
        if (application, name) not in known:
            raise BackupError(
                f"{path} was made by a newer version of this software: {application} is at {name}"
            )
    for name, digest in about.files.items():
        file = folder / name
        if not file.is_file() or _digest(file) != digest:
            raise BackupError(f"{path} is damaged: {name} is not what was stored")


def _refuse_unless_empty() -> None:
    if _vendor() == "sqlite":
        place = _sqlite_file()
        found = next((file for file in _sqlite_files(place) if file.exists() and file.stat().st_size), None)
        if found is not None:
            raise BackupError(f"{found} is there: nothing is replaced; move it away, or set FRONTRUNNER_VAR")
        return
    if connection.introspection.table_names():
        raise BackupError("the database has tables: nothing is replaced; name an empty one in DATABASE_URL")


def _put_sequences(folder: Path) -> None:
    """Packs that are there already stay: a pack's content follows from its name in every front."""
    target = Path(settings.FRONTRUNNER_VAR) / SEQUENCES
    for pack in sorted((folder / SEQUENCES).glob("*")):
        if not (target / pack.name).exists():
            target.mkdir(exist_ok=True)
            shutil.move(pack, target / pack.name)


def _end_exports() -> None:
    """Backups do not contain the files of the open data: their rows would keep new ones from being made."""
    # A backup of an older version may lack a table, or columns that are not named here.
    tables = connection.introspection.table_names()
    ended = Export.objects.filter(withdrawn_at=None)
    for rows in (ExportFile.objects.filter(export__in=ended.values("pk")), ended):
        if rows.model._meta.db_table in tables:
            rows._raw_delete(rows.db)


def _sqlite_file() -> Path:
    return Path(str(connection.settings_dict["NAME"]))


def _sqlite_files(database: Path) -> list[Path]:
    """The database and what belongs to it: a log of another database would be read into this one."""
    return [database, *(database.with_name(f"{database.name}-{more}") for more in ("wal", "shm"))]


def _copy_sqlite(target: Path) -> None:
    source = _sqlite_file()
    if not source.exists():
        raise BackupError(f"there is no database at {source}")
    with (
        closing(sqlite3.connect(f"file:{source}?mode=rw", uri=True)) as live,
        closing(sqlite3.connect(target)) as copy,
    ):
        live.backup(copy)  # all pages in one step: readers and writers go on beside it
        copy.execute("PRAGMA journal_mode=DELETE")  # one file


def _place_sqlite(source: Path) -> None:
    with closing(sqlite3.connect(source)) as copy:
        (state,) = copy.execute("PRAGMA quick_check").fetchone()
    if state != "ok":
        raise BackupError(f"the database in the backup is damaged: {state}")
    for file in _sqlite_files(_sqlite_file()):
        file.unlink(missing_ok=True)  # empty ones, as looked for before
    shutil.move(source, _sqlite_file())


def _dump_postgresql(target: Path) -> None:
    # The archive around it is compressed.
    _tool("pg_dump", "--format=custom", "--compress=0", "--no-owner", "--no-privileges", f"--file={target}")


def _load_postgresql(source: Path) -> None:
    # All of it or nothing.
    _tool("pg_restore", "--no-owner", "--no-privileges", "--single-transaction", str(source))


def _tool(name: str, *options: str) -> None:
    """Run one of PostgreSQL's programs on the database, found as `manage.py dbshell` finds it."""
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
        raise BackupError(f"{name} is not here: {TOOL_REMEDY}") from None
    if done.returncode:
        raise BackupError(f"{name} failed: {done.stderr.strip()} (where versions differ: {TOOL_REMEDY})")
