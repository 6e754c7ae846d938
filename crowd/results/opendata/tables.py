"""The tables of the open data and the meaning of their columns, for the files and their description.

The description is a Data Package of Frictionless Data: one file with schema, licence and digests.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from crowd.demo.mark import file_name, is_demo
from crowd.records.configuration import PublishedConfiguration
from crowd.records.measured_device import DeviceRow
from crowd.records.record import Member, Record, members
from crowd.records.run import Frames, RunRow
from crowd.records.session import SessionFile, Summary
from crowd.records.speedup import Speedup
from crowd.records.tombstone import Erased
from crowd.results.models import ExportFile, StoredFile

SCHEMA_VERSION = 2
LICENCE = {
    "name": "CC-BY-4.0",
    "title": "Creative Commons Attribution 4.0 International",
    "path": "https://creativecommons.org/licenses/by/4.0/",
}


@dataclass(frozen=True)
class Table:
    """A table with a file for each format. It has the columns of `records`, those named `first` first.

    `key` identifies a row. `refers`: other tables by the columns that hold their keys. `only`, `without`: the
    columns of `records` that it has, or has not.
    """

    name: str
    description: str
    records: tuple[type[Record], ...]
    key: tuple[str, ...]
    refers: Mapping[tuple[str, ...], str] = field(default_factory=dict)
    first: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()

    @cached_property
    def columns(self) -> tuple[Member, ...]:
        """Its columns, in order."""
        columns = [
            member
            for record in self.records
            for member in members(record, "column")
            if member.name in (self.only or (member.name,)) and member.name not in self.without
        ]
        return tuple(sorted(columns, key=lambda member: (*self.first, member.name).index(member.name)))


_POINT = ("front", "configuration")
# What the server decides about a run, and may decide otherwise later.
_RUN_STATE = ("mean_us", "state", "reason")
RUNS = Table(
    "runs",
    "One configuration over the whole sequence as it was measured, with the times of every frame.",
    (RunRow, Frames),
    key=("run",),
    refers={("session",): "sessions", _POINT: "configurations"},
    without=_RUN_STATE,
)
TABLES = (
    RUNS,
    Table(
        "run_states",
        "The value of a run, and whether it counts.",
        (RunRow,),
        key=("run",),
        refers={("run",): "runs"},
        only=("run", *_RUN_STATE),
    ),
    Table(
        "sessions",
        "Runs measured one after another on one device. Comparisons are within a session.",
        (SessionFile,),
        key=("session",),
        refers={("device",): "devices"},
        first=("session", "installation", "network_group"),
    ),
    Table(
        "summaries",
        "A session's speedup of one configuration.",
        (Summary,),
        key=("session", "configuration"),
        refers={("session",): "sessions", _POINT: "configurations"},
        first=("session", "front"),
    ),
    Table(
        "figures",
        "The published speedups: one configuration on one device, backend and processor.",
        (Speedup,),
        key=(*_POINT, "device", "backend", "processor", "processor_class"),
        refers={("device",): "devices", _POINT: "configurations"},
    ),
    Table(
        "devices",
        "Devices as the public sees them: a model, or its chip where its name is masked.",
        (DeviceRow,),
        key=("device",),
    ),
    Table(
        "configurations",
        "The points and probes of every published front.",
        (PublishedConfiguration,),
        key=_POINT,
    ),
    Table(
        "tombstones",
        "What was erased. Please delete the rows with these digests from copies of earlier exports.",
        (Erased,),
        key=("tombstone",),
    ),
)


def data_package(name: str, created: str, files: Iterable[ExportFile]) -> dict[str, Any]:
    """The Data Package of the export `name` with its `files`."""
    rows = list(files)
    return {
        "profile": "data-package",
        "name": file_name(f"frontrunner-{name}"),
        "title": "Speedups of dense SLAM configurations, "
        + ("simulated, not measured" if is_demo() else "measured by a crowd"),
        "version": str(SCHEMA_VERSION),
        "created": created,
        "licenses": [LICENCE],
        "resources": [
            {
                "name": _resource(file.name),
                "path": file.name,
                "profile": "tabular-data-resource",
                "format": file.stored.format,
                **_size(file.stored),
                "hash": f"sha256:{file.stored.sha256}",
                "rows": file.stored.rows,
                "description": table.description,
                "schema": {
                    "fields": _fields(table, file.stored.format),
                    "primaryKey": list(table.key),
                    "foreignKeys": _foreign_keys(table, file.stored.format, rows),
                },
            }
            for file in rows
            for table in TABLES
            if table.name == file.stored.table
        ],
    }


def _size(stored: StoredFile) -> dict[str, int]:
    """The size of a resource. Frictionless finds none in Parquet, and would report a difference."""
    return {} if stored.format == "parquet" else {"bytes": stored.bytes}


def _resource(file: str) -> str:
    return file.replace(".", "-")


def _foreign_keys(table: Table, format: str, files: Sequence[ExportFile]) -> list[dict[str, Any]]:
    """The references of `table` to other tables in the same format that have one part."""
    keys = {other.name: other.key for other in TABLES}
    parts: dict[str, list[str]] = {}
    for file in files:
        if file.stored.format == format:
            parts.setdefault(file.stored.table, []).append(_resource(file.name))
    return [
        {
            "fields": list(columns),
            "reference": {"resource": parts[other][0], "fields": list(keys[other])},
        }
        for columns, other in table.refers.items()
        if len(parts[other]) == 1
    ]


def _fields(table: Table, format: str) -> list[dict[str, str]]:
    return [
        {
            "name": column.name,
            "type": _type(column, format),
            "arrow": column.arrow,
            "unit": column.unit,
            "description": column.meaning,
        }
        for column in table.columns
        if format == "parquet" or not column.nested
    ]


def _type(column: Member, format: str) -> str:
    """The type of `column` as Frictionless reads it: from Parquet, integers with gaps are numbers."""
    name = FRICTIONLESS.get(column.arrow, "any")
    return "number" if format == "parquet" and name == "integer" and column.optional else name


# The names of the types in Frictionless. Nested ones have only their Arrow type.
FRICTIONLESS = {
    "string": "string",
    "int32": "integer",
    "int64": "integer",
    "float64": "number",
    "bool": "boolean",
    "timestamp": "datetime",
}
