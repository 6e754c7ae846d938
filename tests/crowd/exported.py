"""The newest export as its readers see it."""

import csv
import gzip
import io
from pathlib import Path
from typing import Any

import pyarrow.parquet

from crowd.results.models import Export
from crowd.results.opendata import exports


def stored(export: Export, name: str) -> Path:
    """Where the file `name` of `export` is now."""
    return exports.exports_folder() / export.folder / export.files.get(name=name).stored_as


def table(name: str) -> list[dict[str, Any]]:
    """Rows of the newest export's table."""
    export = exports.published_exports().first()
    assert export is not None
    rows: list[dict[str, Any]] = pyarrow.parquet.read_table(stored(export, f"{name}.parquet")).to_pylist()
    return rows


def lines(name: str) -> list[dict[str, str]]:
    """Lines of the newest export's CSV."""
    export = exports.published_exports().first()
    assert export is not None
    content = gzip.decompress(stored(export, f"{name}.csv.gz").read_bytes())
    return list(csv.DictReader(io.StringIO(content.decode())))
