"""The file of an SQLite database."""

from pathlib import Path
from typing import Any


def path(connection: Any) -> Path:
    """The file of `connection`, a connection of Django to SQLite."""
    return Path(str(connection.settings_dict["NAME"]))


def with_logs(database: Path) -> list[Path]:
    """The database with its log files: SQLite would apply the log of another database to this one."""
    return [database, *(database.with_name(f"{database.name}-{more}") for more in ("wal", "shm"))]
