"""Reads the rows of the open data from the database, in blocks of bounded size.

Rows do not identify participants: devices are masked here.
"""

import hashlib
import hmac
import json
import math
import secrets
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from operator import attrgetter
from typing import Any
from uuid import UUID

from django.db.models import Count, Exists, Model, OuterRef, Q, QuerySet, TextField, Value
from django.db.models.functions import Cast, Length

from crowd.devices.disclosure import COLUMNS, public_device
from crowd.devices.models import DeviceModel
from crowd.fronts.models import Configuration, FrontVersion
from crowd.records.configuration import PublishedConfiguration
from crowd.records.device import Device
from crowd.records.measured_device import DeviceRow
from crowd.records.record import Record, columns_of, members
from crowd.records.run import RunRow
from crowd.records.session import SessionFile, Summary
from crowd.records.speedup import Speedup
from crowd.results.intake import packing
from crowd.results.intake.stages import STAGES
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.public_rows import speedup_rows

BLOCK_ROWS = 5_000
# The most bytes of packed series, or of samples as text, in a block. A larger row is its own block.
BLOCK_BYTES = 8 << 20
PSEUDONYM_LENGTH = 16
SESSION = "session_key"

# Values by column. `frame_us`, `stages_us` and `tracked` are packed, `samples` is JSON text. Blocks of runs,
# sessions and summaries have the keys of their sessions under SESSION.
Block = dict[str, list[Any]]
# Returns the pseudonym of an installation, from the ids of a session and of the installation.
Pseudonym = Callable[[UUID, UUID], str]


def random_pseudonyms() -> Pseudonym:
    """Random pseudonyms of installations, for one export. Their key is not stored."""
    key = secrets.token_bytes(32)

    def pseudonym(session: UUID, installation: UUID) -> str:  # noqa: ARG001 - the same in all sessions
        return hmac.new(key, str(installation).encode(), hashlib.sha256).hexdigest()[:PSEUDONYM_LENGTH]

    return pseudonym


@dataclass(frozen=True)
class Scope:
    """The rows to read: sessions from `first_session` to `last_session`, runs up to `last_run`."""

    last_session: int
    last_run: int
    first_session: int = 0
    pseudonym: Pseudonym = field(default_factory=random_pseudonyms, repr=False)

    @classmethod
    def now(cls) -> "Scope":
        """Everything that is stored now."""
        return cls(_newest(MeasurementSession), _newest(Run))


def runs(scope: Scope) -> Iterator[Block]:
    """Runs by session, in the order of storage."""
    names = _configurations()
    rows = Run.objects.filter(_in_scope(scope, "session_id"), pk__lte=scope.last_run)
    size = Length("frame_us") + Length("stages_us") + Length("tracked")
    columns = (
        "session_id",
        "session__uuid",
        "configuration_id",
        "stages",
        "frame_us",
        "stages_us",
        "tracked",
    )
    for block in _blocks(rows, *columns, *columns_of(Run, RunRow), key="session_id", size=size):
        stages = list(map(without_unknown_stages, block.pop("stages"), block["stages_us"]))
        yield block | {
            SESSION: block["session_id"],
            "run": _texts(block["uuid"]),
            "session": _texts(block["session__uuid"]),
            "front": [names[key][0] for key in block["configuration_id"]],
            "configuration": [names[key][1] for key in block["configuration_id"]],
            "stages_us": stages,
        }


def sessions(scope: Scope) -> Iterator[Block]:
    """Sessions in the order of storage."""
    rows = MeasurementSession.objects.filter(_in_scope(scope, "pk"))
    as_text = Cast("samples", TextField())
    rows = rows.annotate(samples_text=as_text)
    devices = _public_devices()
    plain = [name for name in columns_of(MeasurementSession, SessionFile) if name != "samples"]
    for block in _blocks(
        rows, "installation_id", "device_id", "front__application", "front__slug", "submission__app_version",
        "submission__consent_version", "samples_text", *plain, size=Length(as_text),
    ):  # fmt: skip
        yield block | {
            SESSION: block["pk"],
            "session": _texts(block["uuid"]),
            "installation": list(map(scope.pseudonym, block["uuid"], block["installation_id"])),
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
            "speedup": [None if ratio is None else math.exp(ratio) for ratio in block["log_ratio"]],
        }


def figures(scope: Scope) -> Iterator[Block]:
    """The published speedups of real devices."""
    devices = _public_devices()
    rows = DeviceSpeedup.objects.filter(_measured_in_scope(scope, "device_id"))
    for block in _blocks(rows):
        selected = rows.filter(pk__gte=block["pk"][0], pk__lte=block["pk"][-1]).order_by("pk")
        yield _block_of(speedup_rows(selected, devices), Speedup)


def devices(scope: Scope) -> Iterator[Block]:
    """The devices of the sessions, with their numbers of sessions and installations."""
    counted = Q(sessions__pk__lte=scope.last_session)
    rows = DeviceModel.objects.filter(_measured_in_scope(scope, "pk")).annotate(
        session_count=Count("sessions", filter=counted),
        installation_count=Count("sessions__installation", filter=counted, distinct=True),
    )
    public = _public_devices()
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
    rows = Configuration.objects.filter(front__in=FrontVersion.objects.released())
    texts = ("parameters", "predicted", "learned_on", "held_out")
    columns = ("front__application", "front__slug", "name", "front__state", "front__published_at")
    for block in _blocks(rows, *columns, *columns_of(Configuration, PublishedConfiguration)):
        yield block | {
            "application": block["front__application"],
            "front": block["front__slug"],
            "configuration": block["name"],
            **{name: [json.dumps(value) for value in block[name]] for name in texts},
            "state": block["front__state"],
            "published_at": block["front__published_at"],
        }


def tombstones(scope: Scope) -> Iterator[Block]:  # noqa: ARG001 - the same signature for all tables
    """Records of erased data."""
    for block in _blocks(Tombstone.objects.all(), "kind", "erased_at", "id_sha256", "single"):
        yield block | {"tombstone": _texts(block["pk"]), "erased_at": _round_to_hours(block["erased_at"])}


READERS: dict[str, Callable[[Scope], Iterator[Block]]] = {
    "runs": runs,
    "sessions": sessions,
    "summaries": summaries,
    "figures": figures,
    "devices": devices,
    "configurations": configurations,
    "tombstones": tombstones,
}


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


def _public_devices() -> dict[int, Device]:
    """All device models as the public sees them, by key."""
    return {model.pk: public_device(model) for model in DeviceModel.objects.only(*COLUMNS)}


def _configurations() -> dict[int, tuple[str, str]]:
    """The front and name of each configuration by key."""
    rows = Configuration.objects.values_list("pk", "front__slug", "name")
    return {key: (front, name) for key, front, name in rows}


def _newest(model: type[Model]) -> int:
    return model._default_manager.order_by("-pk").values_list("pk", flat=True).first() or 0


def _texts(values: list[Any]) -> list[str]:
    return [str(value) for value in values]


def _round_to_hours(moments: list[datetime | None]) -> list[datetime | None]:
    """Round down to the hour, so that a row cannot be matched with a person's day."""
    return [moment and moment.replace(minute=0, second=0, microsecond=0) for moment in moments]
