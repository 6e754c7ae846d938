"""Writes tables as files of bounded size. Importing this module imports Arrow, which is slow."""

import hashlib
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from crowd.results.models import ExportFile
from crowd.results.opendata.part_writer import PartWriter
from crowd.results.opendata.reading import SESSION, Block
from crowd.results.opendata.tables import Table

# The size of a part: of its Parquet file, and of its values before compression. Both determine the cost of
# rewriting it.
PART_BYTES = 32 << 20
UNCOMPRESSED_BYTES = 128 << 20
SUFFIXES = {"parquet": "parquet", "csv": "csv.gz"}


def write_table(table: Table, blocks: Iterable[Block], folder: Path) -> list[ExportFile]:
    """Write `blocks` to `folder` as parts of `table`. Returns unsaved rows, two files for each part.

    A session is never split between parts. An empty table has one part without rows.
    """
    left = iter(blocks)
    block = next(left, None)
    parts: list[PartWriter] = []
    while block is not None or not parts:
        with _writer(table, folder) as writer:
            while block is not None:
                writer.write(block)
                block = next(left, None)
                if _is_full(writer) and not _continues_session(writer, block):
                    break
        parts.append(writer)
    return [
        file
        for number, writer in enumerate(parts, 1)
        for file in _describe(writer, number, f"-{number}" if len(parts) > 1 else "")
    ]


def write_part(table: Table, blocks: Iterable[Block], folder: Path) -> list[ExportFile]:
    """Write `blocks` to `folder` as one part of any size. Returns the unsaved rows of its two files."""
    with _writer(table, folder) as writer:
        for block in blocks:
            writer.write(block)
    return list(_describe(writer, 1, ""))


@contextmanager
def _writer(table: Table, folder: Path) -> Iterator[PartWriter]:
    """A writer of two new files, which are deleted if writing fails."""
    stem = f"{table.name}-{secrets.token_hex(8)}"
    parquet, csv = (folder / f"{stem}.{suffix}" for suffix in SUFFIXES.values())
    try:
        with PartWriter(table, parquet, csv) as writer:
            yield writer
    except BaseException:
        parquet.unlink(missing_ok=True)
        csv.unlink(missing_ok=True)
        raise


def _is_full(writer: PartWriter) -> bool:
    return writer.bytes >= PART_BYTES or writer.uncompressed_bytes >= UNCOMPRESSED_BYTES


def _continues_session(writer: PartWriter, block: Block | None) -> bool:
    """Whether `block` continues the session that `writer` wrote last."""
    return block is not None and SESSION in block and block[SESSION][0] == writer.last_session


def _describe(writer: PartWriter, part: int, suffix: str) -> Iterator[ExportFile]:
    for format, path in (("parquet", writer.parquet), ("csv", writer.csv)):
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        yield ExportFile(
            table=writer.table.name,
            part=part,
            format=format,
            name=f"{writer.table.name}{suffix}.{SUFFIXES[format]}",
            stored_as=path.name,
            rows=writer.rows,
            bytes=path.stat().st_size,
            sha256=digest,
            first_session=writer.first_session,
            last_session=writer.last_session,
        )
