"""Rows of the open data, read from the database in parts of bounded size: who measured is never among them.

Simulated installations are left out everywhere. Devices are those of the public: a session names a rare
model by what it shares with others.
"""

import hashlib
import hmac
import json
import math
import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from django.db.models import Count, Exists, Model, OuterRef, Q, QuerySet

from crowd.devices.models import DeviceModel
from crowd.fronts.models import Configuration, FrontVersion
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run, SessionSummary, Tombstone

AT_ONCE = 5_000
PSEUDONYM_LENGTH = 16

# Values by column; `frame_us`, `stages_us` and `tracked` as they are packed.
Part = dict[str, list[Any]]


@dataclass(frozen=True)
class Scope:
    """What one export covers: the rows that were there when it began, under a key that is then forgotten."""

    last_session: int
    last_run: int
    key: bytes = field(default_factory=lambda: secrets.token_bytes(32), repr=False)

    @classmethod
    def now(cls) -> "Scope":
        """Everything stored at this moment."""
        return cls(_newest(MeasurementSession), _newest(Run))

    def pseudonym(self, installation: Any) -> str:
        """A name for INSTALLATION that tells it from others here and says nothing elsewhere."""
        return hmac.new(self.key, str(installation).encode(), hashlib.sha256).hexdigest()[:PSEUDONYM_LENGTH]


def runs(scope: Scope) -> Iterator[Part]:
    """Runs in the order in which they were stored."""
    names = _configurations()
    rows = Run.objects.filter(
        pk__lte=scope.last_run, session_id__lte=scope.last_session, session__installation__simulated=False
    )
    plain = (
        *("repeat", "order", "status", "mean_us", "tracked_frames", "ate_max", "ate_mean", "ate_rmse"),
        *("trajectory_sha256", "state", "reason", "frame_us", "tracked"),
    )
    for part in _parts(rows, "uuid", "session__uuid", "configuration_id", "stages", "stages_us", *plain):
        stages = list(zip(part.pop("stages"), part["stages_us"], strict=True))
        yield part | {
            "run": _texts(part["uuid"]),
            "session": _texts(part["session__uuid"]),
            "front": [names[key][0] for key in part["configuration_id"]],
            "configuration": [names[key][1] for key in part["configuration_id"]],
            "stages_us": stages,
        }


def sessions(scope: Scope) -> Iterator[Part]:
    """Sessions in the order in which they were stored."""
    rows = MeasurementSession.objects.filter(pk__lte=scope.last_session, installation__simulated=False)
    plain = ("protocol_version", "backend", "processor", "platform", "driver", "samples")
    for part in _parts(
        rows, "uuid", "installation_id", "device__slug", "front__application", "front__slug",
        "submission__app_version", "submission__consent_version", "started_at", "received_at", *plain,
    ):  # fmt: skip
        yield part | {
            "session": _texts(part["uuid"]),
            "installation": [scope.pseudonym(key) for key in part["installation_id"]],
            "device": part["device__slug"],
            "application": part["front__application"],
            "front": part["front__slug"],
            "app_version": part["submission__app_version"],
            "consent_version": part["submission__consent_version"],
            "started_at": _hours(part["started_at"]),
            "received_at": _hours(part["received_at"]),
        }


def summaries(scope: Scope) -> Iterator[Part]:
    """The answers of those sessions."""
    names = _configurations()
    rows = SessionSummary.objects.filter(
        session_id__lte=scope.last_session, session__installation__simulated=False
    )
    plain = ("log_ratio", "pairs", "drift", "ate_max", "state", "reason", "algorithm")
    for part in _parts(rows, "session__uuid", "configuration_id", "baseline_id", *plain):
        yield part | {
            "session": _texts(part["session__uuid"]),
            "front": [names[key][0] for key in part["configuration_id"]],
            "configuration": [names[key][1] for key in part["configuration_id"]],
            "baseline": [names[key][1] for key in part["baseline_id"]],
            "speedup": [None if ratio is None else math.exp(ratio) for ratio in part["log_ratio"]],
        }


def figures(scope: Scope) -> Iterator[Part]:
    """The published speedups of devices that somebody really measured."""
    names = _configurations()
    rows = DeviceSpeedup.objects.filter(_measured(scope, "device_id"))
    plain = (
        *("backend", "processor", "speedup", "low", "high", "repeat_low", "repeat_high", "sessions"),
        *("installations", "ate_max", "state", "algorithm"),
    )
    for part in _parts(rows, "device__slug", "configuration_id", "baseline_id", "last_session_at", *plain):
        yield part | {
            "device": part["device__slug"],
            "front": [names[key][0] for key in part["configuration_id"]],
            "configuration": [names[key][1] for key in part["configuration_id"]],
            "baseline": [names[key][1] for key in part["baseline_id"]],
            "last_session_at": _hours(part["last_session_at"]),
        }


def devices(scope: Scope) -> Iterator[Part]:
    """The devices that sessions name, with counts of those sessions."""
    real = Q(sessions__installation__simulated=False, sessions__pk__lte=scope.last_session)
    rows = DeviceModel.objects.filter(_measured(scope, "pk")).annotate(
        session_count=Count("sessions", filter=real),
        installation_count=Count("sessions__installation", filter=real, distinct=True),
    )
    plain = ("manufacturer", "name", "market_name", "cpu", "soc", "gpu", "os")
    for part in _parts(rows, "slug", "session_count", "installation_count", *plain):
        yield part | {
            "device": part["slug"],
            "name": [
                DeviceModel(manufacturer=maker, name=name, market_name=market).shown_name
                for maker, name, market in zip(
                    part["manufacturer"], part["name"], part["market_name"], strict=True
                )
            ],
            "sessions": part["session_count"],
            "installations": part["installation_count"],
        }


def configurations(scope: Scope) -> Iterator[Part]:  # noqa: ARG001 - all tables are read alike
    """The points of the fronts that were ever published."""
    rows = Configuration.objects.filter(front__in=FrontVersion.objects.released())
    for part in _parts(
        rows, "front__application", "front__slug", "name", "position", "parameters", "predicted",
        "front__state", "front__published_at",
    ):  # fmt: skip
        yield part | {
            "application": part["front__application"],
            "front": part["front__slug"],
            "configuration": part["name"],
            "parameters": [json.dumps(value) for value in part["parameters"]],
            "predicted": [json.dumps(value) for value in part["predicted"]],
            "state": part["front__state"],
            "published_at": part["front__published_at"],
        }


def tombstones(scope: Scope) -> Iterator[Part]:  # noqa: ARG001 - all tables are read alike
    """What was erased."""
    for part in _parts(Tombstone.objects.all(), "kind", "erased_at", "id_sha256"):
        yield part | {"tombstone": _texts(part["pk"]), "erased_at": _hours(part["erased_at"])}


READERS: dict[str, Callable[[Scope], Iterator[Part]]] = {
    "runs": runs,
    "sessions": sessions,
    "summaries": summaries,
    "figures": figures,
    "devices": devices,
    "configurations": configurations,
    "tombstones": tombstones,
}


def _parts(rows: "QuerySet[Any]", *names: str) -> Iterator[Part]:
    """ROWS by their primary keys, AT_ONCE at a time: each part is one query, none is held while waiting."""
    ordered = rows.order_by("pk").values_list("pk", *names)
    found = list(ordered[:AT_ONCE])
    while found:
        yield dict(zip(("pk", *names), map(list, zip(*found, strict=True)), strict=True))
        found = list(ordered.filter(pk__gt=found[-1][0])[:AT_ONCE])


def _measured(scope: Scope, device: str) -> Exists:
    """Whether a real session of SCOPE names the device."""
    return Exists(
        MeasurementSession.objects.filter(
            device_id=OuterRef(device), pk__lte=scope.last_session, installation__simulated=False
        )
    )


def _configurations() -> dict[int, tuple[str, str]]:
    """Front and name of every configuration by its key."""
    rows = Configuration.objects.values_list("pk", "front__slug", "name")
    return {key: (front, name) for key, front, name in rows}


def _newest(model: type[Model]) -> int:
    return model._default_manager.order_by("-pk").values_list("pk", flat=True).first() or 0


def _texts(values: list[Any]) -> list[str]:
    return [str(value) for value in values]


def _hours(moments: list[datetime | None]) -> list[datetime | None]:
    """Rounded down to the hour: a row cannot be matched with a person's day."""
    return [moment and moment.replace(minute=0, second=0, microsecond=0) for moment in moments]
