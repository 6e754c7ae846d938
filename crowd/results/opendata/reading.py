"""Reads the rows of the open data from the database, in blocks of bounded size.

Rows do not identify participants: devices are masked here.
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from operator import attrgetter
from typing import Any

import msgspec
from django.db.models import Count, Exists, F, Model, OuterRef, Q, QuerySet, TextField, Value
from django.db.models.functions import Cast, Length

from crowd.devices.models import DeviceModel
from crowd.fronts.models import Configuration, FrontVersion
from crowd.records.configuration import PublishedConfiguration
from crowd.records.measured_device import DeviceRow
from crowd.records.record import Record, columns_of, members
from crowd.records.run import RunRow
from crowd.records.session import SessionFile, Summary
from crowd.records.speedup import Speedup
from crowd.results.figures.cohorts import KEY_COLUMNS, cohort_key
from crowd.results.figures.cohorts import figures as cohort_figures
from crowd.results.intake import packing
from crowd.results.intake.stages import STAGES
from crowd.results.models import Cohort, DeviceSpeedup, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.opendata.pseudonyms import Pseudonyms, RandomPseudonyms
from crowd.results.public_rows import all_devices, figure_row, round_to_hour

BLOCK_ROWS = 5_000
# The most bytes of packed series, or of samples as text, in a block. A larger row is its own block.
BLOCK_BYTES = 8 << 20
SESSION = "session_key"

# Values by column. `frame_us`, `stages_us` and `tracked` are packed, `samples` is JSON text. Blocks of runs,
# their states, sessions and summaries have the keys of their sessions under SESSION.
Block = dict[str, list[Any]]


@dataclass(frozen=True)
class Scope:
    """The rows to read: sessions and runs by their primary keys, both limits included."""

    last_session: int
    last_run: int
    first_session: int = 0
    first_run: int = 0
    pseudonyms: Pseudonyms = field(default_factory=RandomPseudonyms, repr=False)

    @classmethod
    def now(cls) -> "Scope":
        """Everything that is stored now."""
        newest_run = _newest(Run)  # first, so that its session is in scope
        return cls(_newest(MeasurementSession), newest_run)


def runs(scope: Scope) -> Iterator[Block]:
    """Runs as they were measured, in the order of storage."""
    names = _configurations()
    rows = Run.objects.filter(pk__range=(scope.first_run, scope.last_run))
    # With the plain column SQLite would read the sessions first, all of them for each block.
    rows = rows.annotate(in_session=F("session_id") + 0).filter(_in_scope(scope, "in_session"))
    columns = ("session_id", "session__uuid", "configuration_id", "frames__content")
    for block in _blocks(rows, *columns, *columns_of(Run, RunRow), size=F("frames__size")):
        series = list(map(packing.decompress, block.pop("frames__content")))
        yield block | {
            SESSION: block["session_id"],
            "run": _texts(block["uuid"]),
            "session": _texts(block["session__uuid"]),
            "front": [names[key][0] for key in block["configuration_id"]],
            "configuration": [names[key][1] for key in block["configuration_id"]],
            "frame_us": [each.frame_us for each in series],
            "stages_us": [without_unknown_stages(each.stages, each.stages_us) for each in series],
            "tracked": [each.tracked for each in series],
        }


def run_states(scope: Scope) -> Iterator[Block]:
    """The values and states of the runs, by session."""
    rows = Run.objects.filter(_in_scope(scope, "session_id"), pk__lte=scope.last_run)
    for block in _blocks(rows, "session_id", "uuid", "mean_us", "state", "reason", key="session_id"):
        yield block | {SESSION: block["session_id"], "run": _texts(block["uuid"])}


def sessions(scope: Scope) -> Iterator[Block]:
    """Sessions in the order of storage."""
    rows = MeasurementSession.objects.filter(_in_scope(scope, "pk"))
    as_text = Cast("samples", TextField())
    rows = rows.annotate(samples_text=as_text)
    devices = all_devices()
    shared = _shared_networks([key for key, device in devices.items() if device.masked])
    plain = [name for name in columns_of(MeasurementSession, SessionFile) if name != "samples"]
    for block in _blocks(
        rows, "installation_id", "installation__network", "device_id", "front_id", "front__application",
        "front__slug", "submission__app_version", "submission__consent_version", "samples_text", *plain,
        size=Length(as_text),
    ):  # fmt: skip
        networks = list(
            zip(block["device_id"], block["front_id"], block["installation__network"], strict=True)
        )
        groups = map(scope.pseudonyms.group, block["uuid"], *zip(*networks, strict=True))
        yield block | {
            SESSION: block["pk"],
            "session": _texts(block["uuid"]),
            "installation": list(map(scope.pseudonyms.installation, block["uuid"], block["installation_id"])),
            "network_group": [
                None if devices[network[0]].masked and network not in shared else group
                for network, group in zip(networks, groups, strict=True)
            ],
            "device": [devices[key].slug for key in block["device_id"]],
            "application": block["front__application"],
            "front": block["front__slug"],
            "app_version": block["submission__app_version"],
            "consent_version": block["submission__consent_version"],
            "started_at": _round_to_hours(block["started_at"]),
            "received_at": _round_to_hours(block["received_at"]),
            "samples": block["samples_text"],
        }


def summaries(scope: Scope) -> Iterator[Block]:
    """The summaries of the sessions."""
    names = _configurations()
    rows = SessionSummary.objects.filter(_in_scope(scope, "session_id"))
    columns = ("session_id", "session__uuid", "configuration_id", "baseline_id")
    for block in _blocks(rows, *columns, *columns_of(SessionSummary, Summary), key="session_id"):
        yield block | {
            SESSION: block["session_id"],
            "session": _texts(block["session__uuid"]),
            "front": [names[key][0] for key in block["configuration_id"]],
            "configuration": [names[key][1] for key in block["configuration_id"]],
            "baseline": [names[key][1] for key in block["baseline_id"]],
            "speedup": _ratios(block["log_ratio"]),
            "low": _ratios(block["low"]),
            "high": _ratios(block["high"]),
        }


def figures(scope: Scope) -> Iterator[Block]:
    """The speedups of real devices, computed from the sessions in `scope` as those of the pages are."""
    devices, names = all_devices(), _configurations()
    for block in _blocks(Cohort.objects.filter(_measured_in_scope(scope, "device_id"))):
        cohorts = Cohort.objects.in_bulk(block["pk"])
        in_scope = SessionSummary.objects.filter(cohort__in=block["pk"], session__lte=scope.last_session)
        figures = sorted(
            cohort_figures(in_scope).items(), key=lambda item: (item[0].cohort, item[0].configuration)
        )
        witnesses = _chip_witnesses({cohort.device_id for cohort in cohorts.values()})
        rows = [
            figure_row(
                figure,
                cohort,
                devices[cohort.device_id],
                names[key.configuration],
                names[key.baseline],
                witnesses.get((*cohort_key(cohort), key.configuration), 0),
            )
            for key, figure in figures
            for cohort in [cohorts[key.cohort]]
        ]
        yield _block_of(rows, Speedup)


def devices(scope: Scope) -> Iterator[Block]:
    """The devices of the sessions, with their numbers of sessions and installations."""
    counted = Q(sessions__pk__lte=scope.last_session)
    rows = DeviceModel.objects.filter(_measured_in_scope(scope, "pk")).annotate(
        session_count=Count("sessions", filter=counted),
        installation_count=Count("sessions__installation", filter=counted, distinct=True),
    )
    public = all_devices()
    for block in _blocks(rows, "session_count", "installation_count"):
        counts = zip(block["pk"], block["session_count"], block["installation_count"], strict=True)
        yield _block_of(
            [
                DeviceRow(
                    device=public[key],
                    sessions=measured,
                    installations=owners,
                    last_session_at=None,
                    speedup=None,
                )
                for key, measured, owners in counts
            ],
            DeviceRow,
        )


def configurations(scope: Scope) -> Iterator[Block]:  # noqa: ARG001 - the same signature for all tables
    """The points and probes of all released fronts."""
    for row in FrontVersion.objects.released().order_by("pk"):
        content = row.content
        assert row.published_at is not None  # a constraint of the table
        points = [
            PublishedConfiguration(
                application=row.application,
                front=row.slug,
                configuration=point.name,
                position=position,
                parameters=_json(point.parameters),
                predicted=_json(point.predicted),
                band=point.band,
                skipped=point.skipped,
                probe=position >= len(content.configurations),
                learned_on=_json(point.learned_on),
                held_out=_json(point.held_out),
                state=row.state,
                published_at=row.published_at,
            )
            for position, point in enumerate(content.every)
        ]
        yield _block_of(points, PublishedConfiguration)


def tombstones(scope: Scope) -> Iterator[Block]:  # noqa: ARG001 - the same signature for all tables
    """Records of erased data."""
    for block in _blocks(Tombstone.objects.all(), "kind", "erased_at", "id_sha256", "single"):
        yield block | {"tombstone": _texts(block["pk"]), "erased_at": _round_to_hours(block["erased_at"])}


READERS: dict[str, Callable[[Scope], Iterator[Block]]] = {
    "runs": runs,
    "run_states": run_states,
    "sessions": sessions,
    "summaries": summaries,
    "figures": figures,
    "devices": devices,
    "configurations": configurations,
    "tombstones": tombstones,
}


def _json(value: Any) -> str:
    return json.dumps(msgspec.to_builtins(value))


def _block_of(rows: Sequence[Record], record: type[Record]) -> Block:
    """The columns of `record` of these `rows`."""
    return {
        member.name: list(map(attrgetter(member.attribute), rows)) for member in members(record, "column")
    }


def _in_scope(scope: Scope, key: str) -> Q:
    """Selects rows of sessions in `scope`. `key` is the column with the key of the session."""
    return Q(**{f"{key}__gte": scope.first_session, f"{key}__lte": scope.last_session})


def _blocks(rows: "QuerySet[Any]", *names: str, key: str = "pk", size: Any = None) -> Iterator[Block]:
    """Blocks of `rows`, ordered by `key` and primary key, of at most BLOCK_ROWS rows and BLOCK_BYTES.

    `size` is an expression for the bytes of a row. A block ends with the last row of a `key`, unless that
    `key` alone is too large. Each block is a separate query, so that none is open while a block is written.
    """
    left = ordered = rows.order_by(*dict.fromkeys((key, "pk")))
    while batch := list(_next_rows(left, key, size).values_list("pk", *names)):
        block = dict(zip(("pk", *names), map(list, zip(*batch, strict=True)), strict=True))
        yield block
        left = _after(ordered, key, block[key][-1], block["pk"][-1])


def _next_rows(left: "QuerySet[Any]", key: str, size: Any) -> "QuerySet[Any]":
    """The first rows of `left` that fit into a block."""
    if key == "pk" and size is None:
        return left[:BLOCK_ROWS]
    sizes = list(left.values_list(key, Value(0) if size is None else size)[: BLOCK_ROWS + 1])
    if not sizes:
        return left.none()
    count = _rows_that_fit(sizes)
    # If rows are erased meanwhile, no session whose size is unknown gets into the block.
    return left.filter(**{f"{key}__lte": sizes[count - 1][0]})[:count]


def _rows_that_fit(rows: list[tuple[Any, int]]) -> int:
    """How many of `rows` (keys with sizes) fit into a block: at least one."""
    total = 0
    count = 0
    for _, size in rows[:BLOCK_ROWS]:
        total += size
        if count and total > BLOCK_BYTES:
            break
        count += 1
    if count < len(rows):
        # The next row belongs to the next block. So do all rows with its key, if they do not fill this block.
        begins = next(index for index, (key, _) in enumerate(rows) if key == rows[count][0])
        count = min(begins, count) or count
    return count


def _after(ordered: "QuerySet[Any]", key: str, last: Any, last_pk: Any) -> "QuerySet[Any]":
    """The rows of `ordered` after the row whose `key` is `last` and whose primary key is `last_pk`."""
    if key == "pk":
        return ordered.filter(pk__gt=last_pk)
    return ordered.filter(**{f"{key}__gte": last}).exclude(**{key: last}, pk__lte=last_pk)


def _measured_in_scope(scope: Scope, device: str) -> Exists:
    """Whether a session in `scope` is of the device."""
    return Exists(MeasurementSession.objects.filter(device_id=OuterRef(device), pk__lte=scope.last_session))


def without_unknown_stages(names: list[str], packed: bytes) -> tuple[list[str], bytes]:
    """`names` and their `packed` series, without stages that are not in STAGES."""
    if STAGES.issuperset(names):
        return names, packed
    series = packing.unpack_stages(names, packed)
    kept = [name for name in names if name in STAGES]
    return kept, b"".join(series[name].tobytes() for name in kept)


def _chip_witnesses(devices: set[int]) -> dict[tuple[Any, ...], int]:
    """How many networks of other models with its chip agree with each figure of `devices`."""
    rows = DeviceSpeedup.objects.filter(device__in=devices, chip_witnesses__gt=0)
    columns = rows.values_list(*KEY_COLUMNS, "configuration_id", "chip_witnesses")
    return {tuple(key): witnesses for *key, witnesses in columns}


def _shared_networks(devices: Sequence[int]) -> set[tuple[int, int, str]]:
    """Those of `devices`, with fronts and networks, that several installations of a network measured."""
    columns = ("device_id", "front_id", "installation__network")
    rows = MeasurementSession.objects.filter(device__in=devices).order_by().values_list(*columns)
    counted = rows.annotate(count=Count("installation", distinct=True))
    return {(device, front, network) for device, front, network, count in counted if count > 1}


def _configurations() -> dict[int, tuple[str, str]]:
    """The front and name of each configuration by key."""
    rows = Configuration.objects.values_list("pk", "front__slug", "name")
    return {key: (front, name) for key, front, name in rows}


def _newest(model: type[Model]) -> int:
    return model._default_manager.order_by("-pk").values_list("pk", flat=True).first() or 0


def _ratios(logs: list[float | None]) -> list[float | None]:
    return [None if log is None else math.exp(log) for log in logs]


def _texts(values: list[Any]) -> list[str]:
    return [str(value) for value in values]


def _round_to_hours(moments: list[datetime | None]) -> list[datetime | None]:
    """Round down to the hour, so that a row cannot be matched with a person's day."""
    return [moment and round_to_hour(moment) for moment in moments]
