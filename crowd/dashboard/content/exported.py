"""The newest export of the open data as the page lists it: a row per table, a link per file."""

from dataclasses import dataclass

from crowd.results.models import Export, ExportFile
from crowd.results.opendata import exports
from crowd.results.opendata.description_files import ordered_files
from crowd.results.opendata.tables import TABLES


@dataclass(frozen=True)
class ExportedTable:
    """One table: what a row of it is, how many there are, and its files."""

    name: str
    description: str
    rows: int
    files: tuple[ExportFile, ...]

    @property
    def has_parts(self) -> bool:
        """Whether the table is so large that each format has several files."""
        return any(file.part > 1 for file in self.files)


def newest() -> Export | None:
    """The export that /data/latest/ leads to; None before the first one."""
    return exports.published_exports().prefetch_related("files").first()


def tables_of(export: Export) -> tuple[ExportedTable, ...]:
    """The tables of EXPORT in their order."""
    found = []
    files = ordered_files(export)
    for table in TABLES:
        own = tuple(file for file in files if file.table == table.name)
        if own:
            rows = sum(file.rows for file in own if file.format == "parquet")
            found.append(ExportedTable(table.name, table.description, rows, own))
    return tuple(found)
