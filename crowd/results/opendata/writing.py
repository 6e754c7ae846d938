"""Writes tables as files of bounded size. Importing this module imports Arrow, which is slow."""

import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from crowd.results.marking import WHOLE_TABLES
from crowd.results.models import ExportFile
from crowd.results.opendata.part_writer import PartWriter
from crowd.results.opendata.reading import SESSION, Block
from crowd.results.opendata.storing import describe
from crowd.results.opendata.tables import RUNS, Table

# The size of a part: of its Parquet file, and of its values before compression. Both determine the cost of
# rewriting it.
PART_BYTES = 32 << 20
UNCOMPRESSED_BYTES = 128 << 20
Part = list[ExportFile]
SUFFIXES = {"parquet": "parquet", "csv": "csv.gz"}


def write_table(
    table: Table, blocks: Iterable[Block], folder: Path, shared: Sequence[Part] = ()
) -> list[ExportFile]:
    """Write `blocks` to `folder` as parts of `table`, after the `shared` ones.

    Returns unsaved rows, two files for each part. Only runs of a session may be split between parts. An empty
    table has one part without rows, and WHOLE_TABLES have one in any case.
    """
    left = iter(blocks)
    block = next(left, None)
    parts: list[PartWriter] = []
    while block is not None or not (shared or parts):
        with _writer(table, folder) as writer:
            while block is not None:
                writer.write(block)
                block = next(left, None)
                if _ends_part(writer, block):
                    break
        parts.append(writer)
    return list(_numbered([*shared, *map(_files, parts)]))


def write_part(table: Table, blocks: Iterable[Block], folder: Path) -> list[ExportFile]:
    """Write `blocks` to `folder` as one part of any size. Returns the unsaved rows of its two files."""
    with _writer(table, folder) as writer:
        for block in blocks:
            writer.write(block)
    return _files(writer)


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
    """Whether `block` continues the session that `writer` wrote last. Parts of runs are not by session."""
    if block is None or SESSION not in block or writer.table is RUNS:
        return False
    return bool(block[SESSION][0] == writer.last_session)


def _files(writer: PartWriter) -> Part:
    files = []
    for format, path in (("parquet", writer.parquet), ("csv", writer.csv)):
        file = describe(path, f"{writer.table.name}.{SUFFIXES[format]}", writer.table.name, format)
        file.stored.rows = writer.rows
        file.stored.first_session, file.stored.last_session = writer.first_session, writer.last_session
        file.stored.until_run = writer.last_key if writer.table is RUNS else 0
        files.append(file)
    return files


def _numbered(parts: Sequence[Part]) -> Iterator[ExportFile]:
    """The files of `parts`, whose names have numbers if there are several."""
    for number, files in enumerate(parts, 1):
        for file in files:
            file.part = number
            if len(parts) > 1:
                file.name = f"{file.stored.table}-{number}.{SUFFIXES[file.stored.format]}"
            yield file
