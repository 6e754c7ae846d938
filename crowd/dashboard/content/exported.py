"""An export of the open data, as pages list it."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from itertools import groupby

from crowd.results.models import Export, ExportFile, FileChange
from crowd.results.opendata.description_files import ordered_files
from crowd.results.opendata.rewriting import changes_of
from crowd.results.opendata.tables import TABLES

# Older changes are left to the reader's patience.
CHANGES_SHOWN = 200


@dataclass(frozen=True)
class ExportedTable:
    """A table: the meaning of a row, the number of rows, and its files."""

    name: str
    description: str
    rows: int
    files: tuple[ExportFile, ...]

    @property
    def has_parts(self) -> bool:
        """Whether each format has several files, because the table is large."""
        return any(file.part > 1 for file in self.files)


@dataclass(frozen=True)
class NamedChange:
    """A change of the file `name` of an export."""

    name: str
    change: FileChange


def tables_of(export: Export) -> tuple[ExportedTable, ...]:
    """The tables of `export` in order."""
    tables = []
    files = ordered_files(export)
    for table in TABLES:
        its_files = tuple(file for file in files if file.stored.table == table.name)
        if its_files:
            rows = sum(file.stored.rows or 0 for file in its_files if file.stored.format == "parquet")
            tables.append(ExportedTable(table.name, table.description, rows, its_files))
    return tuple(tables)


def other_files_of(export: Export) -> list[ExportFile]:
    """The files of `export` that describe its tables."""
    return [file for file in ordered_files(export) if file.stored.rows is None]


def changes_by_day(export: Export) -> list[tuple[date, str, list[NamedChange]]]:
    """The newest changes of the files of `export`: day, reason, and each file with its digests."""
    names = {file.stored_id: file.name for file in export.files.all()}
    changes: Iterable[FileChange] = changes_of(export)[:CHANGES_SHOWN]
    groups = groupby(changes, key=lambda change: (change.at.date(), change.get_reason_display()))
    return [
        (day, reason, [NamedChange(names[change.stored_id], change) for change in group])
        for (day, reason), group in groups
    ]
