"""Writes tables as files of bounded size. Importing this module imports Arrow, which is slow."""

import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from crowd.results.marking import WHOLE_TABLES
from crowd.results.models import ExportFile
from crowd.results.opendata.part_writer import PartWriter
from crowd.results.opendata.reading import SESSION, Block
from crowd.results.opendata.storing import describe
from crowd.results.opendata.tables import Table

# The size of a part: of its Parquet file, and of its values before compression. Both determine the cost of
# rewriting it.
PART_BYTES = 32 << 20
UNCOMPRESSED_BYTES = 128 << 20
SUFFIXES = {"parquet": "parquet", "csv": "csv.gz"}


def write_table(table: Table, blocks: Iterable[Block], folder: Path) -> list[ExportFile]:
    """Write `blocks` to `folder` as parts of `table`. Returns unsaved rows, two files for each part.

    A session is never split between parts. An empty table has one part without rows, and WHOLE_TABLES have
    one in any case.
    """
    left = iter(blocks)
    block = next(left, None)
    parts: list[PartWriter] = []
    while block is not None or not parts:
        with _writer(table, folder) as writer:
            while block is not None:
                writer.write(block)
                block = next(left, None)
                if _ends_part(writer, block):
                    break
        parts.append(writer)
    return [
        file
        for number, writer in enumerate(parts, 1)
        for file in _files(writer, number, f"-{number}" if len(parts) > 1 else "")
    ]


def write_part(table: Table, blocks: Iterable[Block], folder: Path) -> list[ExportFile]:
    """Write `blocks` to `folder` as one part of any size. Returns the unsaved rows of its two files."""
    with _writer(table, folder) as writer:
        for block in blocks:
            writer.write(block)
    return list(_files(writer, 1, ""))


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


def _ends_part(writer: PartWriter, following: Block | None) -> bool:
    """Whether `writer` has enough for a part, so that `following` begins another one."""
    full = writer.bytes >= PART_BYTES or writer.uncompressed_bytes >= UNCOMPRESSED_BYTES
    return full and writer.table.name not in WHOLE_TABLES and not _continues_session(writer, following)


def _continues_session(writer: PartWriter, block: Block | None) -> bool:
    """Whether `block` continues the session that `writer` wrote last."""
    return block is not None and SESSION in block and block[SESSION][0] == writer.last_session


def _files(writer: PartWriter, part: int, suffix: str) -> Iterator[ExportFile]:
    for format, path in (("parquet", writer.parquet), ("csv", writer.csv)):
        name = f"{writer.table.name}{suffix}.{SUFFIXES[format]}"
        file = describe(path, name, writer.table.name, format, part)
        file.stored.rows = writer.rows
        file.stored.first_session, file.stored.last_session = writer.first_session, writer.last_session
        yield file
