"""Writes the files of a part of a table, block by block: Parquet, and gzipped CSV without nested columns."""

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from crowd.results.intake import packing
from crowd.results.opendata.reading import SESSION, Block
from crowd.results.opendata.tables import LICENCE, Table

SAMPLE = pa.struct([(name, pa.float64()) for name in ("t", "temperature_c", "cpu_mhz", "battery")])
TYPES = {
    "string": pa.string(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "float64": pa.float64(),
    "bool": pa.bool_(),
    "timestamp": pa.timestamp("s", tz="UTC"),
    "list<uint32>": pa.list_(pa.uint32()),
    "map<string, list<uint32>>": pa.map_(pa.string(), pa.list_(pa.uint32())),
    "list<bool>": pa.list_(pa.bool_()),
    "list<sample>": pa.list_(SAMPLE),
}
# Spreadsheets evaluate text that starts like this.
FORMULA_START = r"^[=+\-@\t\r]"


class PartWriter:
    """Writes one part of `table` as the files `parquet` and CSV. `rows`: the number of rows so far.

    `last_key` is the primary key of the last of them; 0 without one, and in tables that are computed.
    """

    def __init__(self, table: Table, parquet: Path, csv: Path) -> None:
        self.table = table
        self.parquet, self.csv = parquet, csv
        self.rows = self.last_key = 0
        self.uncompressed_bytes = 0
        self.first_session: int | None = None
        self.last_session: int | None = None
        self._schema = schema(table)
        self._plain_array = [column.name for column in table.columns if not column.nested]

    def __enter__(self) -> "PartWriter":
        with ExitStack() as stack:
            self._file = stack.enter_context(pa.OSFile(str(self.parquet), "wb"))
            self._parquet = stack.enter_context(
                pa.parquet.ParquetWriter(self._file, self._schema, compression="zstd")
            )
            stream = stack.enter_context(pa.CompressedOutputStream(str(self.csv), "gzip"))
            plain = pa.schema([self._schema.field(name) for name in self._plain_array])
            self._csv = stack.enter_context(pa.csv.CSVWriter(stream, plain))
            self._open = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    @property
    def bytes(self) -> int:
        """The size of the Parquet file so far."""
        return int(self._file.tell())

    def write(self, block: Block) -> None:
        """Add `block` as a row group."""
        batch = record_batch(self.table, block, self._schema)
        self._parquet.write_batch(batch)
        self._csv.write_batch(_escape_formulas(batch.select(self._plain_array)))
        self.rows += batch.num_rows
        self.uncompressed_bytes += batch.nbytes
        if "pk" in block:
            self.last_key = block["pk"][-1]
        if sessions := block.get(SESSION):
            keys = [key for key in (self.first_session, self.last_session, *sessions) if key is not None]
            self.first_session, self.last_session = min(keys), max(keys)


def schema(table: Table) -> pa.Schema:
    """The Arrow schema of `table`, with meanings, units and licence."""
    fields = [
        pa.field(
            column.name,
            TYPES[column.arrow],
            metadata={"description": column.meaning, "unit": column.unit},
        )
        for column in table.columns
    ]
    return pa.schema(fields, metadata={"description": table.description, "licence": LICENCE["path"]})


def record_batch(table: Table, block: Block, columns: pa.Schema) -> pa.RecordBatch:
    """`block` as a record batch of `table`.

    Packed series are converted without a Python object for each value.
    """
    arrays = [
        PACKED_COLUMNS.get(column.name, _plain_array)(block[column.name], columns.field(column.name).type)
        for column in table.columns
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=columns)


def _plain_array(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    return pa.array(values, kind)


def _series_array(packed: Sequence[bytes], kind: pa.DataType) -> pa.Array:  # noqa: ARG001 - as _plain_array
    lengths = [len(series) // packing.DTYPE.itemsize for series in packed]
    return pa.ListArray.from_arrays(_offsets(lengths), pa.array(packing.unpack(b"".join(packed))))


def _stages_array(packed: Sequence[tuple[list[str], bytes]], kind: pa.DataType) -> pa.Array:  # noqa: ARG001
    names = [name for stages, _ in packed for name in stages]
    lengths = [
        len(series) // packing.DTYPE.itemsize // len(stages) for stages, series in packed for _ in stages
    ]
    values = pa.array(packing.unpack(b"".join(series for stages, series in packed if stages)))
    return pa.MapArray.from_arrays(
        _offsets([len(stages) for stages, _ in packed]),
        pa.array(names, pa.string()),
        pa.ListArray.from_arrays(_offsets(lengths), values),
    )


def _tracked_array(packed: Sequence[bytes], kind: pa.DataType) -> pa.Array:  # noqa: ARG001 - as _plain_array
    codes = np.frombuffer(b"".join(packed), dtype=np.uint8)
    values = pa.array(codes == packing.TRACKED, mask=codes == packing.NEITHER)
    return pa.ListArray.from_arrays(_offsets([len(series) for series in packed]), values)


def _samples_array(texts: Sequence[str], kind: pa.DataType) -> pa.Array:
    """Parses one session at a time: as Python objects, samples take thirty times as much memory."""
    return pa.concat_arrays([pa.array([json.loads(text)], kind) for text in texts])


PACKED_COLUMNS: dict[str, Callable[[Sequence[Any], pa.DataType], pa.Array]] = {
    "frame_us": _series_array,
    "stages_us": _stages_array,
    "tracked": _tracked_array,
    "samples": _samples_array,
}


def _offsets(lengths: Sequence[int]) -> pa.Array:
    return pa.array(np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)]), pa.int32())


def _escape_formulas(batch: pa.RecordBatch) -> pa.RecordBatch:
    """`batch` with an apostrophe before texts that a spreadsheet would evaluate as formulas."""
    arrays = [
        pc.if_else(
            pc.match_substring_regex(column, FORMULA_START),
            pc.binary_join_element_wise("'", column, ""),
            column,
        )
        if pa.types.is_string(column.type)
        else column
        for column in batch.columns
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=batch.schema)
