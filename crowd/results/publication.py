"""Puts sessions under what the public sees of their device: the model, or its group while it is rare.

`crowd.devices.disclosure` decides; here the decision is carried out when installations come and go, when an
administrator merges or splits models, and when rules got better. Everything may be run again at any time.
"""

from collections.abc import Iterable

from django.conf import settings
from django.db import transaction
from django.db.models import Min, Q, QuerySet

from crowd.devices import recognition
from crowd.devices.disclosure import Shown, columns, is_rare, published
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.results import summarising
from crowd.results.models import MeasurementSession
from crowd.results.opendata import exports

BATCH = 500


def settle(keys: Iterable[int]) -> None:
    """Look at the sessions KEYS, which came just now, before they are summarised: is a model of theirs rare
    no longer, was it moved while they came? One query where nothing is rare or to be done.
    """
    rows = MeasurementSession.objects.filter(pk__in=list(keys)).values_list(
        "device_id", "installation__show_model", *columns("description__model")
    )
    rare, misplaced = set(), set()
    for device, show_model, *model in rows.order_by():
        shown = Shown.of(model)
        if shown.rare:
            rare.add(shown.model)
        if device != shown.public(show_model):
            misplaced.add(shown.model)
    misplaced |= {model.pk for model in DeviceModel.objects.filter(pk__in=rare) if _recount(model)}
    for key in sorted(misplaced):
        _place(key)


def republish_waiting(limit: int = BATCH) -> int:
    """Carry out what changed about models, at most LIMIT of them; how many there were."""
    keys = list(DeviceModel.objects.filter(changed=True).order_by("pk").values_list("pk", flat=True)[:limit])
    republish(keys)
    return len(keys)


def republish(keys: Iterable[int]) -> None:
    """Count anew who measured the models KEYS, put their sessions right, and have them summarised again."""
    models = DeviceModel.objects.filter(pk__in=list(keys)).select_related("canonical")
    shown = {model.shown.pk: model.shown for model in models}
    for key in sorted(shown):
        with transaction.atomic():
            _recount(shown[key])
            _place(key, again=True)
            _rename_drivers(key)
            DeviceModel.objects.filter(Q(pk=key) | Q(canonical=key)).update(changed=False)


@transaction.atomic
def after_erasure(keys: Iterable[int]) -> None:
    """The models KEYS (those of the descriptions) lost sessions: what nobody measures any more is forgotten,
    and what few measure goes back to its group.
    """
    models = list(DeviceModel.objects.filter(pk__in=list(keys)).select_related("canonical"))
    DeviceDescription.objects.filter(model__in=models, sessions=None, split=None).delete()
    for model in models:
        if _recount(model.shown):
            _place(model.shown.pk)
    _forget(models)


def _forget(models: Iterable[DeviceModel]) -> None:
    """Delete those of MODELS, and of their groups, that nothing refers to. Decisions are kept, so are their
    models.
    """
    groups = [model.group_id for model in models if model.group_id is not None]
    unused = (
        DeviceModel.objects.filter(
            sessions=None, descriptions=None, members=None, rare_models=None, splits=None, split_from=None
        )
        .exclude(aliases__state__in=_DECIDED)
        .exclude(alias_of__state__in=_DECIDED)
    )
    unused.filter(pk__in=[model.pk for model in models]).delete()
    unused.filter(pk__in=groups, kind=DeviceModel.Kind.GROUP).delete()


_DECIDED = ("accepted", "refused", "undone")


def _recount(model: DeviceModel) -> bool:
    """Whether MODEL, which is shown as itself, became rare or ceased to be; that is stored."""
    enough = max(1, settings.FRONTRUNNER_RARE_BELOW)
    who = _sessions_of(model.pk).values_list("installation_id", flat=True).order_by().distinct()[:enough]
    rare = is_rare(len(who))
    if rare == model.rare:
        return False
    model.rare = rare
    model.save(update_fields=["rare"])
    return True


@transaction.atomic
def _place(key: int, again: bool = False) -> None:
    """Put the sessions of the model KEY and of its aliases under what the public sees; AGAIN: have all of
    them summarised anew, not the moved ones alone.
    """
    model = DeviceModel.objects.select_for_update(of=("self",)).select_related("group").get(pk=key)
    if model.group is None:
        recognition.regroup([model])
    sessions = _sessions_of(key)
    moved: list[int] = []
    for show_model in (False, True):
        target = published(model, show_model)
        wrong = sessions.filter(installation__show_model=show_model).exclude(device=target)
        if target.kind == DeviceModel.Kind.GROUP:
            # Open data that names the model must not outlive its being public.
            named = wrong.exclude(device__kind=DeviceModel.Kind.GROUP)
            if (since := named.aggregate(first=Min("received_at"))["first"]) is not None:
                exports.withdraw(since)
        for keys in _batches(wrong):
            MeasurementSession.objects.filter(pk__in=keys).update(device=target)
            moved += keys
    if again or len(moved) > BATCH:
        for keys in _batches(sessions):
            summarising.resummarise(MeasurementSession.objects.filter(pk__in=keys))
    else:
        # At once, lest a figure stays under a name that is no longer to be seen.
        seen = MeasurementSession.objects.filter(pk__in=moved).exclude(summary_algorithm=None)
        summarising.summarise_sessions(list(seen.values_list("pk", flat=True)))


def _rename_drivers(key: int) -> None:
    """Sessions carry their driver as the present rules name it."""
    for description in DeviceDescription.objects.filter(Q(model=key) | Q(model__canonical=key)):
        description.sessions.exclude(driver=description.driver).update(driver=description.driver)


def _sessions_of(key: int) -> QuerySet[MeasurementSession]:
    """Sessions on the model KEY or on an alias of it."""
    descriptions = DeviceDescription.objects.filter(Q(model=key) | Q(model__canonical=key))
    return MeasurementSession.objects.filter(description__in=descriptions)


def _batches(sessions: QuerySet[MeasurementSession]) -> list[list[int]]:
    """Primary keys of SESSIONS, in parts of a size that every database takes, in one order for everybody."""
    keys = list(sessions.order_by("pk").values_list("pk", flat=True))
    return [keys[start : start + BATCH] for start in range(0, len(keys), BATCH)]
