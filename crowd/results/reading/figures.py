"""Stored figures as rows: what every read of speedups and devices shares."""

from collections.abc import Iterable
from dataclasses import asdict
from datetime import datetime

from django.conf import settings
from django.db.models import F, Q, QuerySet

from crowd.devices.disclosure import COLUMNS, public_device
from crowd.devices.models import DeviceModel
from crowd.results.models import DeviceSpeedup, State
from crowd.results.reading.rows import Device, Speedup

# As many keys as a query names one by one.
FEW = 500
FIGURE = (
    "backend", "processor", "processor_class", "speedup", "low", "high", "session_low", "session_high",
    "repeat_low", "repeat_high", "deviation", "units", "sessions", "installations", "ate_max",
)  # fmt: skip


def simulated_only(simulated: bool, device: str = "device__") -> Q:
    """Either SIMULATED devices alone, or those alone that people measured: the two are never mixed. DEVICE is
    the path to the model.
    """
    made_up = Q(**{f"{device}kind": DeviceModel.Kind.SIMULATED})
    return made_up if simulated else ~made_up


def hour(moment: datetime) -> datetime:
    """MOMENT rounded down, as the public sees it."""
    return moment.replace(minute=0, second=0, microsecond=0)


def device_of(model: DeviceModel) -> Device:
    """MODEL as the public sees it."""
    return Device(**asdict(public_device(model)))


def devices_of(keys: Iterable[int]) -> dict[int, Device]:
    """The models KEYS as the public sees them. One query, a join for many of them."""
    wanted = set(keys)
    models = DeviceModel.objects.only(*COLUMNS)
    if len(wanted) <= FEW:
        models = models.filter(pk__in=wanted)
    return {model.pk: device_of(model) for model in models if model.pk in wanted}


def figures(rows: QuerySet[DeviceSpeedup]) -> list[Speedup]:
    """ROWS in their order. Two queries, of the columns that are shown: fronts are large."""
    found = list(
        rows.values(
            *FIGURE,
            "device_id",
            "witnesses",
            "chip_witnesses",
            "last_session_at",
            "state",
            front_name=F("front__slug"),
            configuration_name=F("configuration__name"),
            baseline_name=F("baseline__name"),
        )
    )
    devices = devices_of(row["device_id"] for row in found)
    return [
        Speedup(
            device=devices[row["device_id"]],
            front=row["front_name"],
            configuration=row["configuration_name"],
            baseline=row["baseline_name"],
            last_session_at=hour(row["last_session_at"]),
            suspect=row["state"] == State.SUSPECT,
            confirmed=is_confirmed(devices[row["device_id"]], row["witnesses"], row["chip_witnesses"]),
            **{name: row[name] for name in FIGURE},
        )
        for row in found
    ]


def is_confirmed(device: Device, *witnesses: int) -> bool:
    """Whether a quorum agrees with a figure of DEVICE; pages of simulated devices treat all as confirmed."""
    return device.simulated or max(witnesses) >= settings.FRONTRUNNER_QUORUM
