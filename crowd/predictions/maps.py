"""The maps of devices: rebuilt every night from figures, and used by all predictions."""

import io
import logging
from collections.abc import Iterable
from datetime import timedelta
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd
from django.utils import timezone
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from crowd.fronts import selectors as fronts
from crowd.predictions import measurements, recommendations, tables
from crowd.predictions.expectations import LearnedMap
from crowd.predictions.measurements import Group
from crowd.predictions.models import DeviceMap
from pareto.devices.device_map import DeviceMap as KnownDevices
from pareto.devices.ladder import Ladder, climb
from pareto.devices.prediction import Belief
from wire.front import BEST, Front

REBUILT_AFTER = timedelta(hours=24)
REFERENCE = "reference"  # the rung of a belief without any measured device

log = logging.getLogger(__name__)


def rebuild_if_due() -> list[DeviceMap]:
    """Rebuild the maps that are missing or older than a day, or made before the clock was set back."""
    now = timezone.now()
    young = {
        Group(*row)
        for row in DeviceMap.objects.filter(made_at__range=(now - REBUILT_AFTER, now)).values_list(
            "front_id", "backend", "processor_class"
        )
    }
    return rebuild([group for group in measurements.groups() if group not in young])


def rebuild(groups: Iterable[Group] | None = None) -> list[DeviceMap]:
    """Rebuild the maps of `groups` (None: all) from the data that is stored now, without erased data.

    A group that fails is logged; the others continue.
    """
    every = measurements.groups()
    made = []
    with threadpool_limits(limits=1, user_api="blas"):  # more threads would only wait for each other
        for group in every if groups is None else groups:
            try:
                made.append(_rebuild_group(group))
            except Exception:
                log.exception("the map of %s cannot be learned", group)
    for row in DeviceMap.objects.defer("belief"):
        if Group(row.front_id, row.backend, row.processor_class) not in every:
            row.delete()
    return made


def _rebuild_group(group: Group) -> DeviceMap:
    front = fronts.front_in_any_state(group.front_id)
    table = tables.read_table(front, group)
    ladder = climb(table.known, [BEST])
    row, _ = DeviceMap.objects.update_or_create(
        **group._asdict(),
        defaults={
            "rung": ladder.rung,
            "scale": ladder.scale,
            "errors": _errors(ladder),
            "quantities": list(table.known.reference.index),
            "belief": _pack_belief(ladder.belief),
            "devices": len(table.rows),
            "sessions": int(table.rows.sessions.sum()),
            "made_at": timezone.now(),
        },
    )
    row.other_recommended = recommendations.store_recommendations(
        front, group, table, learned_map(row, front)
    )
    row.save(update_fields=["other_recommended"])
    log.info("map of %s: rung %s from %d devices", row, row.rung, row.devices)
    return row


def _errors(ladder: Ladder) -> dict[str, dict[str, Any]]:
    """Median relative errors of predicted ratios by rung, with the numbers of ratios, devices, families."""
    errors = {}
    for rung, rows in ladder.residuals.groupby("rung"):
        relative = np.abs(np.expm1(rows.predicted - rows.measured))
        errors[str(rung)] = {
            "median": float(relative.median()),
            "ratios": len(rows),
            "devices": int(rows.device.nunique()),
            "families": int(rows.family.nunique()),
        }
    return errors


def learned_map(row: DeviceMap | None, front: Front) -> LearnedMap:
    """The map of `row`; without one, or if its quantities differ, that of the reference device alone."""
    if row is None or row.quantities != list(tables.reference_ratios(front).index):
        return LearnedMap(REFERENCE, _reference_belief(front.slug, front.digest), 1.0)
    return LearnedMap(row.rung, _unpack_belief(bytes(row.belief)), row.scale, row.devices, row.sessions)


@lru_cache(maxsize=16)
def _reference_belief(slug: str, digest: str) -> Belief:  # noqa: ARG001 - the digest is part of the key
    front = fronts.front(slug)
    assert front is not None  # published fronts are never deleted
    reference = tables.reference_ratios(front)
    nothing = pd.DataFrame(columns=reference.index, dtype=float)
    work = tables.workloads(front, reference.index)
    stages = tables.reference_stage_times(front)
    devices = KnownDevices(nothing, nothing, pd.Series(dtype=object), reference, work, stages)
    return climb(devices, [BEST]).belief


def find_map(group: Group) -> DeviceMap | None:
    """The stored map of `group`; None before its first rebuild. One query."""
    return DeviceMap.objects.filter(**group._asdict()).first()


def _pack_belief(belief: Belief) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, mean=belief.mean, covariance=belief.covariance, relation=belief.relation)
    return stream.getvalue()


def _unpack_belief(content: bytes) -> Belief:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return Belief(arrays["mean"], arrays["covariance"], float(arrays["relation"]))
