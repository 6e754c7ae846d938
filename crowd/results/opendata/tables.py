"""The tables of the open data and the meaning of their columns, for the files and their description.

The description is a Data Package of Frictionless Data: one file with schema, licence and digests.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from crowd.demo.mark import file_name, is_demo
from crowd.results.models import ExportFile

SCHEMA_VERSION = 1
LICENCE = {
    "name": "CC-BY-4.0",
    "title": "Creative Commons Attribution 4.0 International",
    "path": "https://creativecommons.org/licenses/by/4.0/",
}
# Column types that CSV cannot represent: these columns are only in Parquet.
NESTED = ("list", "map")


@dataclass(frozen=True)
class Column:
    """A column: its Arrow type, meaning and unit ("" for none)."""

    name: str
    type: str
    description: str
    unit: str = ""

    @property
    def nested(self) -> bool:
        return self.type.startswith(NESTED)


@dataclass(frozen=True)
class Table:
    """A table, with a file for each format."""

    name: str
    description: str
    columns: tuple[Column, ...]


def _hour(name: str, description: str) -> Column:
    return Column(name, "timestamp", f"{description}, rounded down to the hour (UTC)")


DEVICE = Column("device", "string", "public name of the device: a row of devices")
FRONT = Column("front", "string", "version of the front: with configuration, a row of configurations")
BASELINE = Column("baseline", "string", "the configuration it is compared with")
STATE = Column(
    "state",
    "string",
    "valid, suspect, invalid, quarantined, or pending (not checked yet): valid ones make figures, suspect "
    "ones where none is valid",
)
REASON = Column("reason", "string", "code of the rule that set the state; empty for a valid or pending one")
ALGORITHM = Column("algorithm", "int32", "version of the statistics that computed it")
BACKEND = Column("backend", "string", "what computed, such as opencl")
PROCESSOR = Column("processor", "string", "the chip that computed, as the rules call it")
PROCESSOR_CLASS = Column("processor_class", "string", "cpu or gpu")

RUNS = Table(
    "runs",
    "One configuration over the whole sequence, with the times of every frame.",
    (
        Column("run", "string", "id; /runs/ID/ is its page while it exists"),
        Column("session", "string", "a row of sessions"),
        FRONT,
        Column("configuration", "string", "name of the configuration in that front"),
        Column("repeat", "int32", "which run of this configuration in the session, from 0"),
        Column("order", "int32", "place among all runs of the session, from 0"),
        Column("status", "string", "ok or failed"),
        Column("mean_us", "float64", "the run's value: arithmetic mean over the counted frames", "µs"),
        Column("tracked_frames", "int32", "frames whose tracking succeeded; empty where unknown"),
        Column("ate_max", "float64", "largest distance of the camera from its true place", "m"),
        Column("ate_mean", "float64", "mean distance of the camera from its true place", "m"),
        Column("ate_rmse", "float64", "root of the mean squared distance", "m"),
        Column("deviation", "float64", "largest distance from the reference trajectory", "m"),
        Column("cpu_us", "int64", "processor time over all threads and the counted frames", "µs"),
        Column("waited_us", "int64", "its threads stood ready without a processor, likewise", "µs"),
        STATE,
        REASON,
        Column("frame_us", "list<uint32>", "wall time of the computation of each frame", "µs"),
        Column("stages_us", "map<string, list<uint32>>", "the same of each stage, by its name", "µs"),
        Column("tracked", "list<bool>", "whether tracking succeeded, null where skipped; [] where unknown"),
    ),
)
SESSIONS = Table(
    "sessions",
    "Runs measured one after another on one device. Comparisons are within a session.",
    (
        Column("session", "string", "id; /sessions/ID/ is its page while it exists"),
        Column("installation", "string", "pseudonym of the installation, valid only within this export"),
        DEVICE,
        Column("application", "string", "such as kfusion"),
        FRONT,
        Column("protocol_version", "int32", "version of the measuring protocol"),
        BACKEND,
        PROCESSOR,
        PROCESSOR_CLASS,
        Column("driver", "string", "driver with its version"),
        Column("empty_frame_us", "float64", "time of an empty frame on the backend", "µs"),
        Column("stage_clock", "string", "clock of the stage times: device, wall or none"),
        Column("blocks_repeated", "int32", "blocks of runs measured again because of other programs"),
        Column("app_version", "string", "version of the program that measured"),
        Column("consent_version", "int32", "version of the text that the participant agreed to"),
        _hour("started_at", "when it began by the device's clock"),
        _hour("received_at", "when the server received it"),
        Column(
            "samples",
            "list<sample>",
            "state of the device at most once a second: t (s from the start), temperature_c (°C), "
            "cpu_mhz (MHz), battery (0 to 1); null where the platform hides it",
        ),
    ),
)
SUMMARIES = Table(
    "summaries",
    "A session's speedup of one configuration.",
    (
        Column("session", "string", "a row of sessions"),
        FRONT,
        Column("configuration", "string", "name of the configuration in that front"),
        BASELINE,
        Column("speedup", "float64", "exp(log_ratio): times faster than the baseline"),
        Column("log_ratio", "float64", "mean of the paired natural log ratios; empty without a valid pair"),
        Column("low", "float64", "lower end of the 95 % interval of log_ratio over the session's pairs"),
        Column("high", "float64", "upper end of the same"),
        Column("pairs", "int32", "number of pairs of runs that it is computed from"),
        Column("runs", "int32", "runs of the configuration, in any state"),
        Column("failed", "int32", "of these, how many did not finish"),
        Column("lost", "int32", "of these, how many lost the camera"),
        Column("drift", "float64", "ratio of later over earlier repeats: the farthest from 1"),
        Column("ate_max", "float64", "largest ATE among the configuration's runs", "m"),
        STATE,
        REASON,
        ALGORITHM,
    ),
)
FIGURES = Table(
    "figures",
    "The published speedups: one configuration on one device, backend and processor.",
    (
        DEVICE,
        FRONT,
        Column("configuration", "string", "name of the configuration in that front"),
        BASELINE,
        BACKEND,
        PROCESSOR,
        PROCESSOR_CLASS,
        Column("speedup", "float64", "robust mean over independent installations of their mean speedup"),
        Column("log_ratio", "float64", "natural logarithm of speedup"),
        Column("standard_error", "float64", "of log_ratio; `docs/results/statistics.md` has its formula"),
        Column("low", "float64", "lower end of the 95 % interval over independent installations, from 3 on"),
        Column("high", "float64", "upper end of the same"),
        Column("session_low", "float64", "lower end of the 95 % interval of its only session"),
        Column("session_high", "float64", "upper end of the same"),
        Column("repeat_low", "float64", "repeatability on its only installation, from 3 sessions on"),
        Column("repeat_high", "float64", "upper end of the same"),
        Column("sessions", "int64", "sessions that count"),
        Column("installations", "int64", "installations that count"),
        Column("witnesses", "int64", "independent installations that agree with it"),
        Column("confirmed", "bool", "whether they reach the quorum of this server"),
        Column("ate_max", "float64", "largest ATE of the configuration among those sessions", "m"),
        STATE,
        ALGORITHM,
        _hour("last_session_at", "start of the newest session that counts"),
    ),
)
DEVICES = Table(
    "devices",
    "Devices as the public sees them: a model, or its chip where its name is masked.",
    (
        Column("device", "string", "name in addresses: /devices/NAME/"),
        Column("manufacturer", "string", "maker; empty where unknown"),
        Column("name", "string", "common name of the model, with its code in brackets"),
        Column("cpu", "string", "processor, where known"),
        Column("soc", "string", "system on a chip, where known"),
        Column("gpu", "string", "graphics chip, where known"),
        Column("os", "string", "Android, Linux, macOS, Windows"),
        Column("masked", "bool", "whether the name is that of its chip"),
        Column("sessions", "int64", "sessions measured on it"),
        Column("installations", "int64", "installations that measured on it"),
    ),
)
CONFIGURATIONS = Table(
    "configurations",
    "The points and probes of every published front.",
    (
        Column("application", "string", "such as kfusion"),
        FRONT,
        Column("configuration", "string", "its name: default, best and others"),
        Column("position", "int32", "place in the front's list, from 0"),
        Column("parameters", "string", "JSON: name and value of each parameter"),
        Column("predicted", "string", "JSON: runtime (s), ate_max (m), ate_mean (m) on the reference device"),
        Column("band", "float64", "a run with a larger deviation does not count", "m"),
        Column("probe", "bool", "a configuration beside the front: clients measure it only on request"),
        Column("learned_on", "string", "JSON: largest error (ate_max, m) and lost frames by sequence"),
        Column("held_out", "string", "JSON: the same on sequences that the search did not use"),
        Column("state", "string", "published or retired"),
        Column("published_at", "timestamp", "when clients began to measure it (UTC)"),
    ),
)
TOMBSTONES = Table(
    "tombstones",
    "What was erased. Please delete the rows with these digests from copies of earlier exports.",
    (
        Column("tombstone", "string", "random id"),
        Column("kind", "string", "run, session or installation"),
        _hour("erased_at", "when"),
        Column("id_sha256", "string", "SHA-256 of the run's or session's id; empty for an installation"),
        Column("single", "bool", "a run that its participant deleted individually"),
    ),
)
TABLES = (RUNS, SESSIONS, SUMMARIES, FIGURES, DEVICES, CONFIGURATIONS, TOMBSTONES)


def data_package(name: str, created: str, files: Iterable[ExportFile]) -> dict[str, Any]:
    """The Data Package of the export NAME with its FILES."""
    tables = {table.name: table for table in TABLES}
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
                "name": file.name.replace(".", "-"),
                "path": file.name,
                "format": file.format,
                "bytes": file.bytes,
                "hash": f"sha256:{file.sha256}",
                "rows": file.rows,
                "description": tables[file.table].description,
                "schema": {"fields": _fields(tables[file.table], file.format)},
            }
            for file in files
        ],
    }


def _fields(table: Table, format: str) -> list[dict[str, str]]:
    return [
        {
            "name": column.name,
            "type": FRICTIONLESS.get(column.type, "object"),
            "arrow": column.type,
            "unit": column.unit,
            "description": column.description,
        }
        for column in table.columns
        if format == "parquet" or not column.nested
    ]


# The names of the types in Frictionless. Nested ones are arrays and objects.
FRICTIONLESS = {
    "string": "string",
    "int32": "integer",
    "int64": "integer",
    "float64": "number",
    "bool": "boolean",
    "timestamp": "datetime",
    "list<uint32>": "array",
    "list<bool>": "array",
    "list<sample>": "array",
}
