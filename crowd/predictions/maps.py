"""The maps of devices: rebuilt every night from figures, and read by everything that predicts."""

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
from crowd.fronts.selectors import BEST, Front
from crowd.predictions import recommending, tables
from crowd.predictions.devices import Learned
from crowd.predictions.models import DeviceMap
from crowd.predictions.tables import Group
from pareto.devices.device_map import DeviceMap as KnownDevices
from pareto.devices.ladder import Ladder, climb
from pareto.devices.prediction import Belief

REBUILT_AFTER = timedelta(hours=24)
REFERENCE = "reference"  # the rung of a belief that no crowd has taught anything

log = logging.getLogger(__name__)


def rebuild_if_due() -> list[DeviceMap]:
    """Rebuild the maps that are a day old, and those that are not there yet."""
    young = {
        Group(*row)
        for row in DeviceMap.objects.filter(made_at__gt=timezone.now() - REBUILT_AFTER).values_list(
            "front_id", "backend", "processor_class", "simulated"
        )
    }
    return rebuild([group for group in tables.groups() if group not in young])


def rebuild(groups: Iterable[Group] | None = None) -> list[DeviceMap]:
    """Learn the maps of GROUPS (all of them where None) again from what is stored now: what was erased has no
    influence on them. A group that fails is logged, and the others go on.
    """
    every = tables.groups()
    made = []
    with threadpool_limits(limits=1, user_api="blas"):  # threads would only wait for each other
        for group in every if groups is None else groups:
            try:
                made.append(_rebuilt(group))
            except Exception:
                log.exception("the map of %s cannot be learned", group)
    for row in DeviceMap.objects.defer("belief"):
        if Group(row.front_id, row.backend, row.processor_class, row.simulated) not in every:
            row.delete()
    return made


def _rebuilt(group: Group) -> DeviceMap:
    front = fronts.front_in_any_state(group.front)
    table = tables.read(front, group)
    ladder = climb(table.known, [BEST])
    row, _ = DeviceMap.objects.update_or_create(
        front_id=group.front,
        backend=group.backend,
        processor_class=group.processor_class,
        simulated=group.simulated,
        defaults={
            "rung": ladder.rung,
            "scale": ladder.scale,
            "errors": _errors(ladder),
            "quantities": list(table.known.reference.index),
            "belief": _packed(ladder.belief),
            "devices": len(table.rows),
            "sessions": int(table.rows.sessions.sum()),
            "made_at": timezone.now(),
        },
    )
    row.other_recommended = recommending.record(front, group, table, learned(row, front))
    row.save(update_fields=["other_recommended"])
    log.info("map of %s: rung %s from %d devices", row, row.rung, row.devices)
    return row


def _errors(ladder: Ladder) -> dict[str, dict[str, Any]]:
    """By rung: the median relative error of predicted ratios, the share that lay within their intervals, and
    of how many ratios, devices and families.
    """
    found = {}
    for rung, rows in ladder.residuals.groupby("rung"):
        relative = np.abs(np.expm1(rows.predicted - rows.measured))
        found[str(rung)] = {
            "median": float(relative.median()),
            "ratios": len(rows),
            "devices": int(rows.device.nunique()),
            "families": int(rows.family.nunique()),
        }
    return found


def learned(row: DeviceMap | None, front: Front) -> Learned:
    """What the map ROW learned; without one, or where it has other quantities, what the reference device
    alone says.
    """
    if row is None or row.quantities != list(tables.reference_of(front).index):
        return Learned(REFERENCE, _of_reference(front.slug, front.digest), 1.0)
    return Learned(row.rung, _unpacked(bytes(row.belief)), row.scale, row.devices, row.sessions)


@lru_cache(maxsize=16)
def _of_reference(slug: str, digest: str) -> Belief:  # noqa: ARG001 - the digest is part of the key
    front = fronts.front(slug)
    assert front is not None  # what was published stays
    reference = tables.reference_of(front)
    nothing = pd.DataFrame(columns=reference.index, dtype=float)
    work = tables.work_of(front, reference.index)
    stages = tables.stage_times_of(front)
    known = KnownDevices(nothing, nothing, pd.Series(dtype=object), reference, work, stages)
    return climb(known, [BEST]).belief


def find(group: Group) -> DeviceMap | None:
    """The map of GROUP; None before its first rebuild. One query."""
    return DeviceMap.objects.filter(
        front=group.front,
        backend=group.backend,
        processor_class=group.processor_class,
        simulated=group.simulated,
    ).first()


def _packed(belief: Belief) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, mean=belief.mean, covariance=belief.covariance, relation=belief.relation)
    return stream.getvalue()


def _unpacked(content: bytes) -> Belief:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return Belief(arrays["mean"], arrays["covariance"], float(arrays["relation"]))
