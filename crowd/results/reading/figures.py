"""Stored figures as rows: what every read of speedups and devices shares."""

import hashlib
from datetime import datetime

import msgspec
from django.db.models import Count, F, Max, Q, QuerySet, Sum

from crowd.devices import names
from crowd.devices.models import DeviceModel
from crowd.results.models import DeviceSpeedup, State
from crowd.results.reading.rows import Device, Speedup

DEVICE = ("slug", "manufacturer", "name", "market_name", "cpu", "soc", "gpu", "os", "kind")
FIGURE = (
    "backend", "processor", "speedup", "low", "high", "repeat_low", "repeat_high", "sessions",
    "installations", "ate_max",
)  # fmt: skip


def simulated_only(simulated: bool, device: str = "device__") -> Q:
    """Of SIMULATED devices alone, or of those alone that people measured: the two are never mixed. DEVICE is
    the path to the model.
    """
    made_up = Q(**{f"{device}kind": DeviceModel.Kind.SIMULATED})
    return made_up if simulated else ~made_up


def hour(moment: datetime) -> datetime:
    """MOMENT rounded down, as the public sees it."""
    return moment.replace(minute=0, second=0, microsecond=0)


def device_of(model: DeviceModel) -> Device:
    """MODEL as a row."""
    return Device(
        slug=model.slug,
        manufacturer=model.manufacturer,
        name=model.shown_name,
        cpu=model.cpu,
        soc=model.soc,
        gpu=model.gpu,
        os=model.os,
        kind=model.kind,
    )


def version() -> str:
    """Another text after every change of a stored figure, or of what a model is called and consists of; the
    same in every process. Two queries.
    """
    stored = DeviceSpeedup.objects.aggregate(
        Count("pk"), Max("pk"), Max("computed_at"), Sum("sessions"), Sum("speedup")
    )
    models = DeviceModel.objects.order_by("pk").values_list("pk", "rare", "canonical_id", *DEVICE)
    facts = msgspec.json.encode([list(stored.values()), list(models)])
    return hashlib.blake2b(facts, digest_size=16).hexdigest()


def figures(rows: QuerySet[DeviceSpeedup]) -> list[Speedup]:
    """ROWS in their order. One query, of the columns that are shown: fronts and configurations are large."""
    found = rows.values(
        *FIGURE,
        "device_id",
        "last_session_at",
        "state",
        *(f"device__{name}" for name in DEVICE),
        front_name=F("front__slug"),
        configuration_name=F("configuration__name"),
        baseline_name=F("baseline__name"),
    )
    devices: dict[int, Device] = {}
    for row in found:
        if row["device_id"] not in devices:
            parts = {name: row[f"device__{name}"] for name in DEVICE}
            parts["name"] = names.shown(parts["manufacturer"], parts["name"], parts.pop("market_name"))
            devices[row["device_id"]] = Device(**parts)
    return [
        Speedup(
            device=devices[row["device_id"]],
            front=row["front_name"],
            configuration=row["configuration_name"],
            baseline=row["baseline_name"],
            last_session_at=hour(row["last_session_at"]),
            suspect=row["state"] == State.SUSPECT,
            **{name: row[name] for name in FIGURE},
        )
        for row in found
    ]
