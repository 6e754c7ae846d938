"""Taking the simulated crowd away again: rows, figures, devices. Nothing of it was ever in the open data, so
nothing there has to say that it is gone.
"""

from dataclasses import dataclass

from django.db import transaction
from django.db.models import QuerySet

from crowd.devices import revision
from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.results.models import Decision, MeasurementSession, Run, SessionSummary

INSTALLATIONS, SESSIONS = 50, 500


@dataclass(frozen=True)
class Removed:
    """How much is gone."""

    installations: int
    sessions: int
    devices: int


def remove_crowd() -> Removed:
    """Delete everything that simulated installations sent and what was derived of it. Stopped on its way, it
    may be run again.
    """
    installations, sessions = 0, 0
    simulated = Installation.objects.filter(simulated=True).order_by("pk")
    while keys := list(simulated.values_list("pk", flat=True)[:INSTALLATIONS]):
        with transaction.atomic():
            # Nothing of them is taken in or summarised meanwhile.
            chosen = Installation.objects.filter(pk__in=keys)
            installations += len(chosen.select_for_update().order_by("pk"))
            sessions += _remove_sessions(MeasurementSession.objects.filter(installation__in=keys))
            chosen.delete()
    return Removed(installations, sessions, _remove_devices())


def _remove_sessions(sessions: QuerySet[MeasurementSession]) -> int:
    """What hangs on them goes first, so that nothing is loaded to be deleted."""
    count = 0
    while keys := list(sessions.order_by("pk").values_list("pk", flat=True)[:SESSIONS]):
        for rows in (SessionSummary, Decision, Run):
            rows.objects.filter(session__in=keys).delete()
        MeasurementSession.objects.filter(pk__in=keys).delete()
        count += len(keys)
    return count


@transaction.atomic
def _remove_devices() -> int:
    """Their figures and cohorts go with them."""
    models = DeviceModel.objects.filter(kind=DeviceModel.Kind.SIMULATED)
    DeviceDescription.objects.filter(simulated=True, sessions=None).delete()
    models.update(canonical=None)
    unused = models.filter(sessions=None, descriptions=None)
    count = unused.count()
    unused.delete()
    revision.bump()
    return count
