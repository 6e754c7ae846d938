"""The newest export as its readers see it."""

import csv
import gzip
import io
from datetime import timedelta
from pathlib import Path
from typing import IO, Any

import pyarrow.parquet

from crowd.results.models import Export
from crowd.results.opendata import exports, releases
from crowd.results.opendata.storing import drafts, open_stored, storage


def stored(export: Export, name: str) -> IO[bytes]:
    """The file `name` of `export`, open."""
    return open_stored(export.files.get(name=name).stored)


def copy(export: Export, name: str, folder: Path) -> None:
    """Write the file `name` of `export` to `folder`."""
    (folder / name).write_bytes(stored(export, name).read())


def delete(export: Export, name: str) -> None:
    """Delete the file `name` of `export`, not its row."""
    storage().delete(export.files.get(name=name).stored.stored_as)


def all_files() -> set[str]:
    """The names of all stored files, and of what is being written."""
    return {path.name for path in drafts().iterdir()} | set(storage().listdir("")[1])


def age(days: int) -> None:
    """Let all exports be so many days older."""
    for export in Export.objects.order_by("started_at"):
        export.started_at -= timedelta(days=days)
        export.day = export.day and export.day - timedelta(days=days)
        export.save()


def aged_export(days: int = 40) -> Export:
    """An export of so many days ago."""
    export = exports.create_export()
    age(days)
    export.refresh_from_db()
    return export


def table(name: str) -> list[dict[str, Any]]:
    """Rows of the newest export's table."""
    export = releases.latest()
    assert export is not None
    rows: list[dict[str, Any]] = pyarrow.parquet.read_table(stored(export, f"{name}.parquet")).to_pylist()
    return rows


def lines(name: str) -> list[dict[str, str]]:
    """Lines of the newest export's CSV."""
    export = releases.latest()
    assert export is not None
    content = gzip.decompress(stored(export, f"{name}.csv.gz").read())
    return list(csv.DictReader(io.StringIO(content.decode())))
