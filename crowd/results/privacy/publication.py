"""Puts sessions under what the public sees of their device: the model, or its group while it is rare.

`crowd.devices.disclosure` decides; here the decision is carried out when installations come and go, when an
administrator merges or splits models, and when rules got better. Everything may be run again at any time.
"""

from collections.abc import Iterable

from django.conf import settings
from django.db import transaction
from django.db.models import Q, QuerySet

from crowd.devices import recognition
from crowd.devices.disclosure import Shown, columns, is_rare, published
from crowd.devices.models import DeviceAlias, DeviceDescription, DeviceModel
from crowd.results.figures import refreshing, summarising
from crowd.results.models import Cohort, MeasurementSession, SessionSummary
from crowd.results.opendata import marking

BATCH = 500
DECIDED = (DeviceAlias.State.ACCEPTED, DeviceAlias.State.REFUSED, DeviceAlias.State.UNDONE)


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
    for key in sorted(misplaced | {key for key in rare if _recount(key)}):
        place(key)


def republish_waiting(limit: int = BATCH) -> int:
    """Carry out what changed about models, at most LIMIT of them; how many there were."""
    keys = list(DeviceModel.objects.filter(changed=True).order_by("pk").values_list("pk", flat=True)[:limit])
    republish(keys)
    return len(keys)


def republish(keys: Iterable[int]) -> None:
    """Count anew who measured the models KEYS, put their sessions right, and have them summarised again."""
    models = DeviceModel.objects.filter(pk__in=list(keys)).select_related("canonical")
    for key in sorted({model.shown.pk for model in models}):
        _recount(key)
        with transaction.atomic():
            place(key, again=True)
            _rename_drivers(key)
            DeviceModel.objects.filter(Q(pk=key) | Q(canonical=key)).update(changed=False)


@transaction.atomic
def after_erasure(keys: Iterable[int]) -> list[int]:
    """The models KEYS (those of the descriptions) lost sessions: what nobody measures any more is forgotten.
    Which of the others became rare: `place` each once the erasure is over.
    """
    models = list(DeviceModel.objects.filter(pk__in=list(keys)).select_related("canonical"))
    DeviceDescription.objects.filter(model__in=models, sessions=None, split=None).delete()
    rare = [key for key in sorted({model.shown.pk for model in models}) if _recount(key)]
    # Whoever erases may be killed before that: the sweep does it then.
    DeviceModel.objects.filter(pk__in=rare).update(changed=True)
    _forget(models)
    return rare


def _forget(models: Iterable[DeviceModel]) -> None:
    """Delete those of MODELS, and of their groups, that nothing refers to. Decisions are kept, so are their
    models.
    """
    groups = [model.group_id for model in models if model.group_id is not None]
    unused = (
        DeviceModel.objects.filter(
            sessions=None, descriptions=None, members=None, rare_models=None, splits=None, split_from=None
        )
        .exclude(aliases__state__in=DECIDED)
        .exclude(alias_of__state__in=DECIDED)
    )
    unused.filter(pk__in=[model.pk for model in models]).delete()
    unused.filter(pk__in=groups, kind=DeviceModel.Kind.GROUP).delete()


@transaction.atomic
def _recount(key: int) -> bool:
    """Whether the model KEY, which is shown as itself, became rare or ceased to be; that is stored."""
    # Who counts last has seen what those before have stored.
    model = DeviceModel.objects.select_for_update(no_key=True).filter(pk=key).first()
    if model is None:
        return False
    enough = max(1, settings.FRONTRUNNER_RARE_BELOW)
    who = _sessions_of(model.pk).values_list("installation_id", flat=True).order_by().distinct()[:enough]
    rare = model.kind != DeviceModel.Kind.SIMULATED and is_rare(len(who))
    if rare == model.rare:
        return False
    model.rare = rare
    model.save(update_fields=["rare"])
    return True


@transaction.atomic
def place(key: int, again: bool = False) -> None:
    """Put the sessions of the model KEY and of its aliases under what the public sees; AGAIN: have all of
    them summarised anew, not the moved ones alone.
    """
    models = DeviceModel.objects.filter(pk=key).select_related("group")
    model = models.first()
    if model is None:
        return
    if model.group is None:
        recognition.regroup([model])
    sessions = _sessions_of(key)
    # Installations before models, as everybody.
    summarising.lock_installations(sessions.filter(_misplaced(model, False) | _misplaced(model, True)))
    model = models.select_for_update(of=("self",), no_key=True).get()
    moved: list[int] = []
    hidden: list[int] = []
    devices: set[int] = set()
    for show_model in (False, True):
        target = published(model, show_model)
        wrong = sessions.filter(_misplaced(model, show_model))
        if target.kind == DeviceModel.Kind.GROUP:
            # Open data that names the model must not outlive its being public.
            named = wrong.exclude(device__kind=DeviceModel.Kind.GROUP)
            newly_hidden = list(named.order_by("pk").values_list("pk", flat=True))
            if newly_hidden:
                marking.mark_devices_changed(newly_hidden)
                hidden += newly_hidden
        devices |= set(wrong.order_by().values_list("device", flat=True).distinct())
        for keys in _batches(wrong):
            MeasurementSession.objects.filter(pk__in=keys).update(device=target)
            devices.add(target.pk)
            moved += keys
    refreshing.lock(Cohort.objects.filter(device__in=devices))
    # Before summaries are made: how many sessions a device has decides whether its figures follow at once.
    refreshing.count_activity(devices)
    if again or len(moved) > BATCH:
        for keys in _batches(sessions):
            summarising.resummarise(MeasurementSession.objects.filter(pk__in=keys))
        _withhold(hidden)
    else:
        # At once, lest a figure stays under a name that is no longer to be seen. Large devices wait for the
        # sweep; one that nothing is left under is none.
        seen = MeasurementSession.objects.filter(pk__in=moved).exclude(summary_algorithm=None)
        summarising.summarise_sessions(list(seen.values_list("pk", flat=True)))


def _misplaced(model: DeviceModel, show_model: bool) -> Q:
    """Which sessions on MODEL, of installations that want SHOW_MODEL or not, are not where they belong."""
    return Q(installation__show_model=show_model) & ~Q(device=published(model, show_model))


def _withhold(keys: list[int]) -> None:
    """The sessions KEYS wait to be summarised anew: until then nothing of them counts under a name that is no
    longer to be seen.
    """
    of_them = [SessionSummary.objects.filter(session__in=part) for part in _parts(keys)]
    left = {cohort for rows in of_them for cohort in rows.values_list("cohort", flat=True)}
    cohorts = refreshing.lock(Cohort.objects.filter(pk__in=left))
    for rows in of_them:
        rows.delete()
    refreshing.refresh(cohorts)


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
    return _parts(list(sessions.order_by("pk").values_list("pk", flat=True)))


def _parts(keys: list[int]) -> list[list[int]]:
    return [keys[start : start + BATCH] for start in range(0, len(keys), BATCH)]
