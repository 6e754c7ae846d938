"""Brings the database to the tables of this program: by all migrations that are missing, or by none.

A process that is killed halfway leaves the tables as they were, so that the former program still serves.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from django.core.management import CommandError, call_command
from django.db import connection, connections, transaction
from django.db.migrations.executor import MigrationExecutor
from django.db.migrations.recorder import MigrationRecorder

from crowd.database import sqlite_file

# A migration that every database had before 1.0, and none has since.
BEFORE_1_0 = ("results", "0001_initial")
REFUSAL = "was made before 1.0: this version cannot read it; the version that made it can"


def migrate() -> None:
    """Apply migrations that are missing. Raises CommandError if the database was made before 1.0."""
    if is_behind(connection):
        call_command("migrate", verbosity=0, interactive=False)


def is_behind(database: Any) -> bool:
    """Whether migrations of this program are missing in the database of that connection."""
    executor = MigrationExecutor(database)
    return bool(executor.migration_plan(executor.loader.graph.leaf_nodes()))


def refuse_before_1_0(using: str, **_: Any) -> None:
    """Receiver of pre_migrate: raises CommandError, before any change, if the database is older than 1.0."""
    database = connections[using]
    if BEFORE_1_0 in MigrationRecorder(database).applied_migrations():
        raise CommandError(f"the database {database.settings_dict['NAME']} {REFUSAL}")


@contextmanager
def all_or_nothing(using: str) -> Iterator[None]:
    """Whatever happens within, the database keeps all of its changes or none of them."""
    database = connections[using]
    if database.vendor == "postgresql":
        with transaction.atomic(using):
            yield
    elif database.vendor == "sqlite" and MigrationRecorder(database).applied_migrations():
        refuse_before_1_0(using)
        with _on_a_copy(database):
            yield
    else:  # without tables there is nothing to keep
        yield


def check_constraints(using: str) -> None:
    """Check foreign keys now, and until the transaction ends.

    PostgreSQL alters no table whose rows changed in the same transaction and wait for their checks.
    """
    database = connections[using]
    if database.vendor == "postgresql":
        with database.cursor() as cursor:
            cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")


@contextmanager
def _on_a_copy(database: Any) -> Iterator[None]:
    """Let `database` be a copy of SQLite's file; afterwards the content of the copy replaces the file's.

    SQLite changes some tables outside of transactions. Its backup writes the whole file in one transaction.
    The file is locked meanwhile.
    """
    file = sqlite_file.path(database)
    copy = file.with_name(f"{file.name}-upgrade")
    database.close()
    with closing(sqlite3.connect(file, isolation_level=None)) as original:
        _lock(original, file.name)
        _remove(copy)  # of an upgrade that was killed
        with closing(sqlite3.connect(copy)) as target:
            original.backup(target)
        database.settings_dict["NAME"] = str(copy)
        try:
            yield
        finally:
            database.close()
            database.settings_dict["NAME"] = str(file)
        with closing(sqlite3.connect(copy)) as migrated:
            migrated.backup(original)
    _remove(copy)


def _lock(original: sqlite3.Connection, name: str) -> None:
    """Lock the file until the connection closes. Raises CommandError if others have it open."""
    try:
        original.execute("PRAGMA locking_mode=EXCLUSIVE")
        original.execute("BEGIN EXCLUSIVE")  # which takes the lock
        original.execute("COMMIT")
    except sqlite3.OperationalError as error:
        raise CommandError(
            f"{name} cannot be upgraded ({error}): stop web servers and workers that use it; nothing changed"
        ) from error


def _remove(copy: Path) -> None:
    for file in sqlite_file.with_logs(copy):
        file.unlink(missing_ok=True)
