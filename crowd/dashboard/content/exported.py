"""The newest export of the open data, as the page lists it."""

from dataclasses import dataclass

from crowd.results.models import Export, ExportFile
from crowd.results.opendata import exports
from crowd.results.opendata.description_files import ordered_files
from crowd.results.opendata.tables import TABLES


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


def newest() -> Export | None:
    """The export behind /data/latest/, or None."""
    return exports.published_exports().prefetch_related("files").first()


def tables_of(export: Export) -> tuple[ExportedTable, ...]:
    """The tables of `export` in order."""
    tables = []
    files = ordered_files(export)
    for table in TABLES:
        its_files = tuple(file for file in files if file.table == table.name)
        if its_files:
            rows = sum(file.rows for file in its_files if file.format == "parquet")
            tables.append(ExportedTable(table.name, table.description, rows, its_files))
    return tuple(tables)
