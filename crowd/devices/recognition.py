"""From raw strings to stored models: on first sight, and again when a rule or the catalogue got better."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import msgspec
from django.db import transaction
from django.db.models import CharField, QuerySet

from crowd.devices import catalogue, disclosure, drivers, normalisation
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.devices.normalisation import Identity
from crowd.devices.signals import models_changed
from crowd.prepared import Placeholder, Query

PARTS = ("cpu", "soc", "gpu", "os", "market_name")
BATCH = 200


@dataclass(frozen=True)
class Recognised:
    """What a new session needs of its device: the description's primary key, the model that it is shown as,
    and the driver by name and version.
    """

    description: int
    shown: disclosure.Shown
    driver: str

    def public(self, show_model: bool) -> int:
        """The primary key of what everybody sees of it (`crowd.devices.disclosure`)."""
        key = self.shown.public(show_model)
        assert key is not None  # recognition gives every model its group
        return key


def recognise(raw: dict[str, Any], simulated: bool = False) -> Recognised:
    """The device behind RAW; its description, model and group are stored on first sight. One query else.

    A SIMULATED device has a description and a model of its own, whatever RAW says.
    """
    content = msgspec.json.encode(raw, order="sorted")
    # No JSON begins so.
    digest = hashlib.sha256(b"simulated\n" + content if simulated else content).hexdigest()
    known = _recognised(digest)
    if known is None:
        _describe(raw, digest, simulated)
        known = _recognised(digest)
        assert known is not None  # it was described just now
    return known


def _recognised(digest: str) -> Recognised | None:
    """None before the model has its group."""
    for key, driver, version, *model in _described.rows(digest=digest):
        shown = disclosure.Shown.of(model)
        if shown.group is not None:
            return Recognised(key, shown, f"{driver} {version}".strip())
    return None


def _by_digest() -> "QuerySet[DeviceDescription, tuple[Any, ...]]":
    rows = DeviceDescription.objects.filter(digest=Placeholder("digest", CharField()))
    return rows.order_by().values_list("pk", "driver_name", "driver_version", *disclosure.columns("model"))


_described = Query(_by_digest)


@transaction.atomic
def _describe(raw: dict[str, Any], digest: str, simulated: bool) -> None:
    """Store the description of RAW with its model, and see that the model that is shown has a group."""
    identity, entry = _derived(raw, simulated)
    driver = drivers.driver(raw)
    description, _ = DeviceDescription.objects.get_or_create(
        digest=digest,
        defaults={
            "raw": raw,
            "simulated": simulated,
            "model": _model(identity, entry),
            "driver_name": driver.name,
            "driver_version": driver.version[:50],
            "rules": normalisation.RULES,
        },
    )
    if description.model.shown.group is None:
        _regroup(description.model.shown)


def renormalise_waiting(limit: int = BATCH) -> int:
    """Derive again what older rules derived, at most LIMIT descriptions; how many there were."""
    waiting = DeviceDescription.objects.filter(rules__lt=normalisation.RULES).order_by("pk")[:limit]
    return renormalise(DeviceDescription.objects.filter(pk__in=list(waiting.values_list("pk", flat=True))))


@transaction.atomic
def renormalise(descriptions: QuerySet[DeviceDescription]) -> int:
    """Derive models and drivers of DESCRIPTIONS again; how many. What an administrator decided stays.

    A model all of whose descriptions get one new, free name is renamed and keeps its address, its aliases
    and its sessions; else descriptions move, and their sessions follow in a task. Models whose descriptions
    are not all among DESCRIPTIONS are derived from all of theirs.
    """
    keys = set(descriptions.values_list("model_id", flat=True))
    rows = list(
        DeviceDescription.objects.filter(model_id__in=keys).select_related("model", "split").order_by("pk")
    )
    by_model: dict[int, list[DeviceDescription]] = {}
    for row in rows:
        by_model.setdefault(row.model_id, []).append(row)
    touched: set[int] = set()
    for described in by_model.values():
        touched |= _rederive(described)
    if touched:
        announce(touched)
    return len(rows)


def _rederive(described: list[DeviceDescription]) -> set[int]:
    """Derive one model's descriptions again; keys of the models whose sessions or figures that changes."""
    old = described[0].model
    derived = [(row, *_derived(row.raw, row.simulated)) for row in described]
    ruled = [identity for row, identity, _ in derived if row.split_id is None]
    keys = {identity.key for identity in ruled}
    renamed = len(keys) == 1 and old.key not in keys and old.kind != DeviceModel.Kind.GROUP
    if renamed and not DeviceModel.objects.filter(key__in=keys).exists():
        old.key, old.manufacturer, old.name = ruled[0].key, ruled[0].manufacturer, ruled[0].name
        old.save(update_fields=["key", "manufacturer", "name"])
    touched: set[int] = set()
    reset: dict[int, DeviceModel] = {}
    for row, identity, entry in derived:
        model = old if row.split_id is not None else _model(identity, entry)
        if model.pk not in reset:
            kind = model.kind
            _reset_parts(model, identity, entry)
            reset[model.pk] = model
            if model.kind != kind:
                touched.add(model.pk)
        _complete(reset[model.pk], identity, entry)
        if model.pk != row.model_id:
            touched |= {model.pk, row.model_id}
        driver = drivers.driver(row.raw)
        row.model, row.rules = reset[model.pk], normalisation.RULES
        row.driver_name, row.driver_version = driver.name, driver.version[:50]
        row.save(update_fields=["model", "rules", "driver_name", "driver_version"])
    if old.kind == DeviceModel.Kind.GROUP:
        touched.discard(old.pk)  # nobody measures a group: it is neither counted nor placed
    return touched


def _derived(raw: dict[str, Any], simulated: bool) -> tuple[Identity, catalogue.Entry]:
    return normalisation.identify(raw, simulated), catalogue.look_up(raw)


def _model(identity: Identity, entry: catalogue.Entry) -> DeviceModel:
    """The model with the identity's key. Parts that an earlier device did not tell are filled in."""
    taken = DeviceModel.objects.filter(slug=identity.slug).exclude(key=identity.key).exists()
    slug = identity.distinct_slug if taken else identity.slug
    model, new = DeviceModel.objects.get_or_create(
        key=identity.key,
        defaults={
            "slug": slug,
            "manufacturer": identity.manufacturer,
            "name": identity.name,
            "kind": identity.kind,
            "rare": identity.kind != normalisation.SIMULATED and disclosure.is_rare(1),
            "changed": False,
            **_parts(identity, entry),
        },
    )
    if new:
        _regroup(model)
    else:
        _complete(model, identity, entry)
    return model


def _parts(identity: Identity, entry: catalogue.Entry) -> dict[str, str]:
    """What is told of the device itself; the catalogue fills in what the device kept to itself."""
    return {
        "cpu": identity.cpu,
        "soc": identity.soc or entry.soc,
        "gpu": identity.gpu or entry.gpu,
        "os": identity.os,
        "market_name": entry.market_name,
    }


def _complete(model: DeviceModel, identity: Identity, entry: catalogue.Entry) -> None:
    missing = {
        part: text for part, text in _parts(identity, entry).items() if text and not getattr(model, part)
    }
    if missing:
        for part, value in missing.items():
            setattr(model, part, value)
        model.save(update_fields=list(missing))
        _regroup(model)


def _reset_parts(model: DeviceModel, identity: Identity, entry: catalogue.Entry) -> None:
    """What older rules said of MODEL goes; its kind stays where an administrator set it."""
    for part, value in _parts(identity, entry).items():
        setattr(model, part, value)
    if not model.judged_by:
        model.kind = identity.kind
    model.save(update_fields=[*PARTS, "kind"])
    _regroup(model)


def regroup(models: Iterable[DeviceModel]) -> None:
    """Give each of MODELS the group that its parts ask for."""
    for model in models:
        _regroup(model)


def _regroup(model: DeviceModel) -> None:
    group = disclosure.group_of(model)
    if model.group is not None and model.group.key == group.key:
        return
    earlier = model.group_id
    slug = normalisation.slug_of("", group.name)
    if DeviceModel.objects.filter(slug=slug).exclude(key=group.key).exists():
        slug = normalisation.slug_of("", group.name, group.key)
    model.group, _ = DeviceModel.objects.get_or_create(
        key=group.key,
        defaults={
            "slug": slug,
            "name": group.name[:150],
            "cpu": group.cpu,
            "soc": group.soc,
            "gpu": group.gpu,
            "os": group.os,
            "kind": DeviceModel.Kind.GROUP,
            "rare": False,
            "changed": False,
            "examined": True,
        },
    )
    model.save(update_fields=["group"])
    if earlier is not None:
        announce({model.pk})


def announce(keys: Iterable[int]) -> None:
    """Mark the models KEYS, and tell after the transaction that their sessions may have to move."""
    changed = sorted(set(keys))
    DeviceModel.objects.filter(pk__in=changed).update(changed=True)
    transaction.on_commit(lambda: models_changed.send(sender=DeviceModel, keys=changed))


def mark_all() -> list[int]:
    """Mark every model for a new count of who measured it; their primary keys."""
    models = DeviceModel.objects.exclude(kind=DeviceModel.Kind.GROUP)
    models.update(changed=True)
    return list(models.values_list("pk", flat=True))
