"""Stored figures and device models as public rows."""

from collections.abc import Iterable, Mapping
from datetime import datetime

from django.conf import settings
from django.db.models import F, QuerySet

from crowd.devices.disclosure import COLUMNS, public_device
from crowd.devices.models import DeviceModel
from crowd.results.models import DeviceSpeedup, State
from crowd.results.reading.rows import Device, Speedup

# With more keys, a query reads all rows instead.
MAX_KEYS = 500
FIGURE_COLUMNS = (
    "backend", "processor", "processor_class", "speedup", "low", "high", "session_low", "session_high",
    "repeat_low", "repeat_high", "deviation", "units", "unit_logs", "sessions", "installations", "ate_max",
)  # fmt: skip


def round_to_hour(moment: datetime) -> datetime:
    """MOMENT rounded down to the hour, as the public sees it."""
    return moment.replace(minute=0, second=0, microsecond=0)


def to_device(model: DeviceModel) -> Device:
    """MODEL as the public sees it."""
    return Device(**vars(public_device(model)))


def read_devices(keys: Iterable[int]) -> dict[int, Device]:
    """The models KEYS as the public sees them. One query."""
    wanted = set(keys)
    models = DeviceModel.objects.only(*COLUMNS)
    if len(wanted) <= MAX_KEYS:
        models = models.filter(pk__in=wanted)
    return {model.pk: to_device(model) for model in models if model.pk in wanted}


def speedup_rows(rows: QuerySet[DeviceSpeedup], devices: Mapping[int, Device]) -> list[Speedup]:
    """Those of ROWS that are of DEVICES, as public figures, in order.

    One query, of the shown columns only: fronts are large.
    """
    found = list(
        rows.values(
            *FIGURE_COLUMNS,
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
    return [
        Speedup(
            device=devices[row["device_id"]],
            front=row["front_name"],
            configuration=row["configuration_name"],
            baseline=row["baseline_name"],
            last_session_at=round_to_hour(row["last_session_at"]),
            suspect=row["state"] == State.SUSPECT,
            confirmed=is_confirmed(row["witnesses"], row["chip_witnesses"]),
            **{name: row[name] for name in FIGURE_COLUMNS},
        )
        for row in found
        if row["device_id"] in devices
    ]


def is_confirmed(*witnesses: int) -> bool:
    """Whether a quorum agrees with a figure that has these numbers of WITNESSES."""
    return max(witnesses) >= settings.FRONTRUNNER_QUORUM
