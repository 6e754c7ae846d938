"""Stored figures and device models as public rows."""

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any

from django.conf import settings
from django.db.models import F, QuerySet

from crowd.devices.disclosure import COLUMNS, public_device
from crowd.devices.models import DeviceModel
from crowd.devices.naming.chips import vendor
from crowd.records.device import Device
from crowd.records.record import columns_of
from crowd.records.speedup import Speedup
from crowd.results.figures.cohorts import Figure
from crowd.results.models import Cohort, DeviceSpeedup
from crowd.results.validity.version import ALGORITHM

# With more keys, a query reads all rows instead.
MAX_KEYS = 500
FIGURE_COLUMNS = columns_of(DeviceSpeedup, Speedup)
DEVICE_COLUMNS = tuple(f"device__{name}" for name in COLUMNS)


def round_to_hour(moment: datetime) -> datetime:
    """`moment` rounded down to the hour, as the public sees it."""
    return moment.replace(minute=0, second=0, microsecond=0)


def read_devices(keys: Iterable[int]) -> dict[int, Device]:
    """The models `keys` as the public sees them. One query."""
    wanted = set(keys)
    models = DeviceModel.objects.only(*COLUMNS)
    if len(wanted) <= MAX_KEYS:
        models = models.filter(pk__in=wanted)
    return {model.pk: public_device(model) for model in models if model.pk in wanted}


def all_devices() -> dict[int, Device]:
    """All models as the public sees them, by key. One query."""
    return {model.pk: public_device(model) for model in DeviceModel.objects.only(*COLUMNS)}


def devices_of(rows: Iterable[Mapping[str, Any]]) -> dict[int, Device]:
    """The models of `rows`, which have DEVICE_COLUMNS, as the public sees them."""
    distinct = {row["device__pk"]: row for row in rows}
    return {
        key: public_device(DeviceModel(**{name: row[f"device__{name}"] for name in COLUMNS}))
        for key, row in distinct.items()
    }


def speedup_rows(rows: QuerySet[DeviceSpeedup], devices: Mapping[int, Device]) -> list[Speedup]:
    """Those of `rows` that are of `devices`, as public figures, in order.

    One query, of the shown columns only: fronts are large.
    """
    records = rows.values(
        *FIGURE_COLUMNS,
        "device_id",
        "chip_witnesses",
        "state",
        front_name=F("front__slug"),
        configuration_name=F("configuration__name"),
        skipped=F("configuration__skipped"),
        baseline_name=F("baseline__name"),
    )
    return [_speedup(row, devices[row["device_id"]]) for row in records if row["device_id"] in devices]


def _speedup(row: Mapping[str, Any], device: Device) -> Speedup:
    witnesses = max(row["witnesses"], row["chip_witnesses"])
    extra = {
        "witnesses": witnesses,
        "confirmed": is_confirmed(witnesses),
        "last_session_at": round_to_hour(row["last_session_at"]),
        "front": row["front_name"],
        "configuration": row["configuration_name"],
        "skipped": row["skipped"],
        "baseline": row["baseline_name"],
    }
    copied = {name: row[name] for name in FIGURE_COLUMNS}
    return Speedup(
        device=device,
        vendor=vendor(row["processor"], device.gpu, row["processor_class"]),
        validity=row["state"],
        **(copied | extra),
    )


def figure_row(
    figure: Figure,
    cohort: Cohort,
    device: Device,
    configuration: tuple[str, str],
    baseline: tuple[str, str],
    chip_witnesses: int = 0,
) -> Speedup:
    """`figure`, computed from some sessions of `cohort`, as a public figure.

    `configuration`, `baseline`: their front and name.
    """
    witnesses = max(figure.witnesses, chip_witnesses)
    return Speedup(
        device=device,
        vendor=vendor(cohort.processor, device.gpu, cohort.processor_class),
        front=configuration[0],
        configuration=configuration[1],
        baseline=baseline[1],
        **{name: getattr(cohort, name) for name in ("backend", "processor", "processor_class")},
        **figure.numbers | {"witnesses": witnesses},
        last_session_at=round_to_hour(figure.last_session_at),
        validity=figure.state,
        algorithm=ALGORITHM,
        confirmed=is_confirmed(witnesses),
    )


def is_confirmed(*witnesses: int) -> bool:
    """Whether a quorum agrees with a figure that has these numbers of `witnesses`."""
    return max(witnesses) >= settings.FRONTRUNNER_QUORUM
