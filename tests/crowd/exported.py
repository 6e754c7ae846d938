"""The newest export as its readers see it."""

import csv
import gzip
import io
from datetime import timedelta
from pathlib import Path
from typing import Any

import pyarrow.parquet

from crowd.results.models import Export
from crowd.results.opendata import releases
from crowd.results.opendata.storing import path_of


def stored(export: Export, name: str) -> Path:
    """Where the file `name` of `export` is now."""
    return path_of(export.files.get(name=name).stored)


def age(days: int) -> None:
    """Let all exports be so many days older."""
    for export in Export.objects.order_by("started_at"):
        export.started_at -= timedelta(days=days)
        export.day = export.day and export.day - timedelta(days=days)
        export.save()


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
    content = gzip.decompress(stored(export, f"{name}.csv.gz").read_bytes())
    return list(csv.DictReader(io.StringIO(content.decode())))
