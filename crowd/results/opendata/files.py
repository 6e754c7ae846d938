"""A table's two files, written part by part: Parquet with everything, gzipped CSV with what fits a line."""

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
from crowd.results.opendata.reading import Part
from crowd.results.opendata.tables import LICENCE, Table

SAMPLE = pa.struct([(name, pa.float64()) for name in ("t", "temperature_c", "cpu_mhz", "battery")])
TYPES = {
    "string": pa.string(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "float64": pa.float64(),
    "timestamp": pa.timestamp("s", tz="UTC"),
    "list<uint32>": pa.list_(pa.uint32()),
    "map<string, list<uint32>>": pa.map_(pa.string(), pa.list_(pa.uint32())),
    "list<bool>": pa.list_(pa.bool_()),
    "list<sample>": pa.list_(SAMPLE),
}
# A spreadsheet computes a text that begins so.
FORMULA = r"^[=+\-@\t\r]"


class TableFiles:
    """NAME.parquet and NAME.csv.gz in FOLDER while they are written; `rows` counts."""

    def __init__(self, table: Table, folder: Path) -> None:
        self.table = table
        self.parquet = folder / f"{table.name}.parquet"
        self.csv = folder / f"{table.name}.csv.gz"
        self.rows = 0
        self._schema = schema(table)
        self._plain = [column.name for column in table.columns if not column.nested]

    def __enter__(self) -> "TableFiles":
        with ExitStack() as stack:
            self._parquet = stack.enter_context(
                pa.parquet.ParquetWriter(self.parquet, self._schema, compression="zstd")
            )
            stream = stack.enter_context(pa.CompressedOutputStream(str(self.csv), "gzip"))
            plain = pa.schema([self._schema.field(name) for name in self._plain])
            self._csv = stack.enter_context(pa.csv.CSVWriter(stream, plain))
            self._open = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)

    def write(self, part: Part) -> None:
        """One more part, as a row group of its own."""
        batch = record_batch(self.table, part, self._schema)
        self._parquet.write_batch(batch)
        self._csv.write_batch(_for_spreadsheets(batch.select(self._plain)))
        self.rows += batch.num_rows


def schema(table: Table) -> pa.Schema:
    """TABLE's columns with their meanings and units, and the licence."""
    fields = [
        pa.field(
            column.name,
            TYPES[column.type],
            metadata={"description": column.description, "unit": column.unit},
        )
        for column in table.columns
    ]
    return pa.schema(fields, metadata={"description": table.description, "licence": LICENCE["path"]})


def record_batch(table: Table, part: Part, columns: pa.Schema) -> pa.RecordBatch:
    """PART as TABLE's columns; packed series are taken over as they are, without a Python number each."""
    arrays = [
        PACKED.get(column.name, _plain)(part[column.name], columns.field(column.name).type)
        for column in table.columns
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=columns)


def _plain(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    return pa.array(values, kind)


def _series(packed: Sequence[bytes], kind: pa.DataType) -> pa.Array:  # noqa: ARG001 - as _plain
    lengths = [len(series) // packing.TYPE.itemsize for series in packed]
    return pa.ListArray.from_arrays(_offsets(lengths), pa.array(packing.unpack(b"".join(packed))))


def _stages(packed: Sequence[tuple[list[str], bytes]], kind: pa.DataType) -> pa.Array:  # noqa: ARG001
    names = [name for stages, _ in packed for name in stages]
    lengths = [
        len(series) // packing.TYPE.itemsize // len(stages) for stages, series in packed for _ in stages
    ]
    values = pa.array(packing.unpack(b"".join(series for stages, series in packed if stages)))
    return pa.MapArray.from_arrays(
        _offsets([len(stages) for stages, _ in packed]),
        pa.array(names, pa.string()),
        pa.ListArray.from_arrays(_offsets(lengths), values),
    )


def _tracked(packed: Sequence[bytes], kind: pa.DataType) -> pa.Array:  # noqa: ARG001 - as _plain
    codes = np.frombuffer(b"".join(packed), dtype=np.uint8)
    values = pa.array(codes == packing.TRACKED, mask=codes == packing.NEITHER)
    return pa.ListArray.from_arrays(_offsets([len(series) for series in packed]), values)


PACKED: dict[str, Callable[[Sequence[Any], pa.DataType], pa.Array]] = {
    "frame_us": _series,
    "stages_us": _stages,
    "tracked": _tracked,
}


def _offsets(lengths: Sequence[int]) -> pa.Array:
    return pa.array(np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)]), pa.int32())


def _for_spreadsheets(batch: pa.RecordBatch) -> pa.RecordBatch:
    """BATCH with an apostrophe before texts that a spreadsheet would take for a formula."""
    arrays = [
        pc.if_else(
            pc.match_substring_regex(column, FORMULA), pc.binary_join_element_wise("'", column, ""), column
        )
        if pa.types.is_string(column.type)
        else column
        for column in batch.columns
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=batch.schema)
