"""The newest export of the open data as the page lists it: a row per table, a link per format."""

from dataclasses import dataclass
from typing import Any

from crowd.results.models import Export
from crowd.results.opendata import exports
from crowd.results.opendata.tables import TABLES


@dataclass(frozen=True)
class ExportedTable:
    """One table: what a row of it is, how many there are, and its files."""

    name: str
    description: str
    rows: int
    files: tuple[dict[str, Any], ...]


def newest() -> Export | None:
    """The export that /data/latest/ leads to; None before the first night and after an erasure."""
    return exports.published().first()


def tables_of(export: Export) -> tuple[ExportedTable, ...]:
    """The tables of EXPORT in their order."""
    found = []
    for table in TABLES:
        files = tuple(file for file in export.files if file["table"] == table.name)
        if files:
            found.append(ExportedTable(table.name, table.description, files[0]["rows"], files))
    return tuple(found)
