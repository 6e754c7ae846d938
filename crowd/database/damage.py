"""Names a damaged database, or one that does not answer, and the remedy."""

import sqlite3

from django.conf import settings
from django.db import OperationalError, connection

# SQLite's result codes for a file that was overwritten or cut short, and the bits of an extended code.
DAMAGED, PRIMARY_CODE = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}), 0xFF
# Classes of PostgreSQL's codes: data_corrupted and others; connection_failure and admin_shutdown. A server
# that was not reached gave no code.
POSTGRESQL_DAMAGED, POSTGRESQL_AWAY = "XX", ("08", "57P")
RESTORE = "and restore the newest backup: frontrunner admin restore FILE"


class DamagedError(Exception):
    """The database is damaged; the message says what to do."""


def check() -> None:
    """Raise DamagedError if the file of SQLite is damaged anywhere. Reads all of it."""
    if connection.vendor == "sqlite":
        with connection.cursor() as cursor:
            check_answer(cursor.execute("PRAGMA quick_check(1)").fetchone())


def check_answer(answer: tuple[str]) -> None:
    """Raise DamagedError unless `answer`, the first row of SQLite's quick_check, is good."""
    if answer != ("ok",):
        raise DamagedError(_of_sqlite(answer[0].replace("\n", " ")))


def describe(error: Exception) -> str | None:
    """The message for `error`; None if the database is neither damaged nor away."""
    if isinstance(error, DamagedError):
        return str(error)
    cause = error if isinstance(error, sqlite3.Error) else error.__cause__
    if isinstance(cause, sqlite3.Error):
        damaged = getattr(cause, "sqlite_errorcode", 0) & PRIMARY_CODE in DAMAGED
        return _of_sqlite(str(cause)) if damaged else None
    state = getattr(cause, "sqlstate", "") or ""
    reason = " ".join(str(error).split())
    if state.startswith(POSTGRESQL_DAMAGED):
        return f"PostgreSQL reports damage ({reason}): name an empty database in DATABASE_URL, {RESTORE}"
    if isinstance(error, OperationalError) and (not state or state.startswith(POSTGRESQL_AWAY)):
        return f"the database of DATABASE_URL does not answer ({reason}): start it, or correct DATABASE_URL"
    return None


def _of_sqlite(reason: str) -> str:
    file = settings.DATABASES["default"]["NAME"]
    return f"the database {file} is damaged ({reason}): move it, {file}-wal and {file}-shm away, {RESTORE}"
