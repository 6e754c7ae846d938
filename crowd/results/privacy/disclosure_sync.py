"""Keeps up to date which device models are named in public, as installations come and go.

`crowd.devices.disclosure` defines masks and applies them when rows are read. Nothing here changes sessions or
figures.
"""

from collections.abc import Iterable

from django.db import transaction

from crowd.devices.disclosure import public_device
from crowd.devices.models import DeviceAlias, DeviceDescription, DeviceModel
from crowd.devices.services import refresh_disclosure
from crowd.results import marking

DECIDED_STATES = (DeviceAlias.State.ACCEPTED, DeviceAlias.State.REFUSED, DeviceAlias.State.UNDONE)


def after_arrival(sessions: Iterable[int]) -> None:
    """Count the installations of the rare models among new `sessions`. One query if none is rare."""
    rare = DeviceModel.objects.filter(sessions__in=list(sessions), rare=True).order_by("pk").distinct()
    sync_disclosure(rare.values_list("pk", flat=True))


def sync_disclosure(keys: Iterable[int]) -> None:
    """Count the installations of the models `keys`, and mark open data whose public device changed."""
    for key in list(keys):
        refresh_disclosure(key)
        _sync_open_data(key)


@transaction.atomic
def _sync_open_data(key: int) -> None:
    model = DeviceModel.objects.select_for_update(no_key=True).filter(pk=key).first()
    slug = "" if model is None else public_device(model).slug
    if model is None or model.published_slug == slug:
        return
    if model.published_slug:
        marking.mark_devices_changed(list(model.sessions.order_by().values_list("pk", flat=True)))
    DeviceModel.objects.filter(pk=key).update(published_slug=slug)


@transaction.atomic
def after_erasure(keys: Iterable[int]) -> None:
    """Delete those of the models `keys`, and their descriptions, that have no sessions; count the others.

    Models that an administrator decided on are kept.
    """
    models = list(DeviceModel.objects.filter(pk__in=list(keys)).select_related("canonical"))
    DeviceDescription.objects.filter(model__in=models, sessions=None, split=None).delete()
    unused = (
        DeviceModel.objects.filter(
            sessions=None, descriptions=None, members=None, splits=None, split_from=None
        )
        .exclude(aliases__state__in=DECIDED_STATES)
        .exclude(alias_of__state__in=DECIDED_STATES)
    )
    unused.filter(pk__in=[model.pk for model in models]).delete()
    sync_disclosure(sorted({model.canonical_or_self.pk for model in models}))
