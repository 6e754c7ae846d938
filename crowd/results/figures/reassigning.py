"""Moves sessions to the device model, driver and chip that their description now belongs to.

Rules improve, and administrators merge or split models. Everything here can run again at any time.
"""

from collections.abc import Iterable

from django.db import transaction
from django.db.models import Q, QuerySet

from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.devices.naming.chips import CPU
from crowd.devices.naming.computing import ON_PROCESSOR, central_processor
from crowd.results import marking
from crowd.results.figures import sessions as session_figures
from crowd.results.models import MeasurementSession

BATCH = 500


def changed_models() -> list[int]:
    """The keys of at most BATCH models that are marked as changed."""
    return list(DeviceModel.objects.filter(changed=True).order_by("pk").values_list("pk", flat=True)[:BATCH])


def reassign_sessions(keys: Iterable[int]) -> set[int]:
    """Move the sessions of the models `keys`, and of their aliases, to where their descriptions belong.

    They are marked for a new summary. Returns the keys of the models that they count for now.
    """
    models = DeviceModel.objects.filter(pk__in=list(keys)).select_related("canonical")
    shown = {model.canonical_or_self.pk for model in models}
    for key in sorted(shown):
        _reassign(key)
    return shown


@transaction.atomic
def _reassign(key: int) -> None:
    """Move the sessions of the model `key` and of its aliases."""
    sessions = MeasurementSession.objects.filter(description__in=_descriptions(key))
    session_figures.lock_installations(sessions)
    left = set(sessions.exclude(device=key).values_list("device", flat=True).distinct())
    central = central_processor(*DeviceModel.objects.values_list("soc", "cpu").get(pk=key))
    for description in _descriptions(key).only(
        "processor", "processor_class", "driver_name", "driver_version"
    ):
        described = description.sessions.all()
        for of_backend, processor, kind in (
            (described.filter(backend__in=ON_PROCESSOR), central, CPU),
            (described.exclude(backend__in=ON_PROCESSOR), description.processor, description.processor_class),
        ):
            columns = {
                "device": key,
                "processor": processor,
                "processor_class": kind,
                "driver": description.driver,
            }
            of_backend.exclude(**columns).update(**columns)
    session_figures.mark_for_summary(sessions)
    if left:
        marking.mark_devices_changed(list(sessions.order_by().values_list("pk", flat=True)))
    session_figures.count_activity(left | {key})
    DeviceModel.objects.filter(Q(pk=key) | Q(canonical=key)).update(changed=False)


def _descriptions(key: int) -> QuerySet[DeviceDescription]:
    """The descriptions of the model `key` and of its aliases."""
    return DeviceDescription.objects.filter(Q(model=key) | Q(model__canonical=key))
