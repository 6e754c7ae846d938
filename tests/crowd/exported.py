"""The newest export as its readers see it."""

import csv
import gzip
import io
from typing import Any

import pyarrow.parquet

from crowd.results.opendata import exports


def table(name: str) -> list[dict[str, Any]]:
    """Rows of the newest export's table."""
    export = exports.published().first()
    assert export is not None
    rows: list[dict[str, Any]] = pyarrow.parquet.read_table(
        exports.root() / export.folder / f"{name}.parquet"
    ).to_pylist()
    return rows


def lines(name: str) -> list[dict[str, str]]:
    """Lines of the newest export's CSV."""
    export = exports.published().first()
    assert export is not None
    content = gzip.decompress((exports.root() / export.folder / f"{name}.csv.gz").read_bytes())
    return list(csv.DictReader(io.StringIO(content.decode())))
