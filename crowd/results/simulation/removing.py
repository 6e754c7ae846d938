"""Deletes the simulated crowd: rows, figures and devices. It was never in the open data: no tombstones."""

from dataclasses import dataclass

from django.db import transaction
from django.db.models import QuerySet

from crowd.devices import revision
from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.results.models import Decision, MeasurementSession, Run, SessionSummary

INSTALLATIONS, SESSIONS = 50, 500


@dataclass(frozen=True)
class Removed:
    """How much was deleted."""

    installations: int
    sessions: int
    devices: int


def remove_crowd() -> Removed:
    """Delete all data of simulated installations. After an interruption, run it again."""
    installations, sessions = 0, 0
    simulated = Installation.objects.filter(simulated=True).order_by("pk")
    while keys := list(simulated.values_list("pk", flat=True)[:INSTALLATIONS]):
        with transaction.atomic():
            # The lock keeps out new submissions and summaries.
            chosen = Installation.objects.filter(pk__in=keys)
            installations += len(chosen.select_for_update().order_by("pk"))
            sessions += _remove_sessions(MeasurementSession.objects.filter(installation__in=keys))
            chosen.delete()
    return Removed(installations, sessions, _remove_devices())


def _remove_sessions(sessions: QuerySet[MeasurementSession]) -> int:
    """Delete SESSIONS; rows that refer to them first, so that Django loads nothing before it deletes."""
    count = 0
    while keys := list(sessions.order_by("pk").values_list("pk", flat=True)[:SESSIONS]):
        for rows in (SessionSummary, Decision, Run):
            rows.objects.filter(session__in=keys).delete()
        MeasurementSession.objects.filter(pk__in=keys).delete()
        count += len(keys)
    return count


@transaction.atomic
def _remove_devices() -> int:
    """Delete simulated devices with their figures and cohorts."""
    models = DeviceModel.objects.filter(kind=DeviceModel.Kind.SIMULATED)
    DeviceDescription.objects.filter(simulated=True, sessions=None).delete()
    models.update(canonical=None)
    unused = models.filter(sessions=None, descriptions=None)
    count = unused.count()
    unused.delete()
    revision.bump()
    return count
