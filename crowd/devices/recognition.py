"""From raw strings to stored models: on first sight, and again when a rule or the catalogue got better."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import msgspec
from django.db import transaction
from django.db.models import CharField, QuerySet

from crowd.database.prepared import CompiledQuery, Placeholder
from crowd.devices import chips, disclosure, revision
from crowd.devices.catalogue import lookup
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.devices.naming import drivers, normalisation, processors
from crowd.devices.naming.normalisation import Identity
from crowd.devices.signals import models_changed

PARTS = ("cpu", "soc", "gpu", "os", "market_name")
BATCH = 200


@dataclass(frozen=True)
class Recognised:
    """What a new session needs of its device: primary keys of the description and of the model that it counts
    for, whether that is named by consent alone, the driver by name and version, the chip that computed.
    """

    description: int
    model: int
    named_by_consent: bool
    driver: str
    processor: str
    processor_class: str


def recognise(raw: dict[str, Any], simulated: bool = False) -> Recognised:
    """The device behind RAW; its description and model are stored on first sight. One query else.

    A SIMULATED device has a description and a model of its own, whatever RAW says.
    """
    content = msgspec.json.encode(raw, order="sorted")
    # JSON never begins so.
    digest = hashlib.sha256(b"simulated\n" + content if simulated else content).hexdigest()
    known = _recognised(digest)
    if known is None:
        _describe(raw, digest, simulated)
        known = _recognised(digest)
        assert known is not None  # it was described just now
    return known


def _recognised(digest: str) -> Recognised | None:
    for key, driver, version, processor, kind, *models in _described.rows(digest=digest):
        own, canonical = models[:3], models[3:]
        model, rare, consented = own if canonical[0] is None else canonical
        return Recognised(key, model, rare and consented, f"{driver} {version}".strip(), processor, kind)
    return None


def _by_digest() -> "QuerySet[DeviceDescription, tuple[Any, ...]]":
    rows = DeviceDescription.objects.filter(digest=Placeholder("digest", CharField()))
    shown = (f"model__{path}{name}" for path in ("", "canonical__") for name in ("pk", "rare", "consented"))
    return rows.order_by().values_list(
        "pk", "driver_name", "driver_version", "processor", "processor_class", *shown
    )


_described = CompiledQuery(_by_digest)


@transaction.atomic
def _describe(raw: dict[str, Any], digest: str, simulated: bool) -> None:
    """Store the description of RAW with its model."""
    identity, entry = _derived(raw, simulated)
    DeviceDescription.objects.get_or_create(
        digest=digest,
        defaults={
            "raw": raw,
            "simulated": simulated,
            "model": _model(identity, entry),
            "rules": normalisation.RULES,
            **_computed_by(raw),
        },
    )


def _computed_by(raw: dict[str, Any]) -> dict[str, str]:
    """Driver and processor of a description, by the names of its columns."""
    driver, processor = drivers.driver(raw), processors.processor_of(raw)
    return {
        "driver_name": driver.name,
        "driver_version": driver.version[:50],
        "processor": processor.name[:200],
        "processor_class": processor.kind,
    }


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
    renamed = len(keys) == 1 and old.key not in keys
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
        computed_by = _computed_by(row.raw)
        if model.pk != row.model_id or row.processor != computed_by["processor"]:
            touched |= {model.pk, row.model_id}
        row.model, row.rules = reset[model.pk], normalisation.RULES
        for name, value in computed_by.items():
            setattr(row, name, value)
        row.save(update_fields=["model", "rules", *computed_by])
    return touched


def _derived(raw: dict[str, Any], simulated: bool) -> tuple[Identity, lookup.Entry]:
    return normalisation.identify(raw, simulated), lookup.look_up(raw)


def _model(identity: Identity, entry: lookup.Entry) -> DeviceModel:
    """The model with the identity's key. Parts that an earlier device did not tell are filled in."""
    model, new = DeviceModel.objects.get_or_create(
        key=identity.key,
        defaults={
            "slug": _free_slug(identity),
            "manufacturer": identity.manufacturer,
            "name": identity.name,
            "kind": identity.kind,
            "named": identity.named or bool(entry.market_name),
            "rare": identity.kind != normalisation.SIMULATED and disclosure.is_rare(1),
            "changed": False,
            **_parts(identity, entry),
        },
    )
    if not new:
        _complete(model, identity, entry)
    return model


def _free_slug(identity: Identity) -> str:
    taken = DeviceModel.objects.filter(slug=identity.slug).exclude(key=identity.key).exists()
    return identity.distinct_slug if taken else identity.slug


def _parts(identity: Identity, entry: lookup.Entry) -> dict[str, str]:
    """What the device tells of itself; the catalogue adds what the device leaves out."""
    return {
        "cpu": identity.cpu,
        "soc": identity.soc or entry.soc,
        "gpu": _closer(identity.gpu, entry.gpu),
        "os": identity.os,
        "market_name": entry.market_name,
    }


def _closer(gpu: str, other: str) -> str:
    """GPU, or OTHER where GPU is unknown, or only says the family of OTHER."""
    return other if other and (not gpu or (chips.is_one_chip(other) and not chips.is_one_chip(gpu))) else gpu


def _complete(model: DeviceModel, identity: Identity, entry: lookup.Entry) -> None:
    missing = {
        part: text for part, text in _parts(identity, entry).items() if text and not getattr(model, part)
    }
    if (gpu := _closer(model.gpu, identity.gpu)) != model.gpu:
        missing["gpu"] = gpu
    if missing:
        for part, value in missing.items():
            setattr(model, part, value)
        model.named = model.named or bool(model.market_name)
        model.save(update_fields=[*missing, "named"])
        revision.bump()


def _reset_parts(model: DeviceModel, identity: Identity, entry: lookup.Entry) -> None:
    """Replace what older rules said of MODEL; its kind and name stay where an administrator judged them."""
    for part, value in _parts(identity, entry).items():
        setattr(model, part, value)
    if not model.judged_by:
        model.kind = identity.kind
        model.named = identity.named or bool(entry.market_name)
    if not identity.named:
        # Older rules made addresses of what devices said.
        model.slug = _free_slug(identity)
    model.save(update_fields=[*PARTS, "kind", "named", "slug"])
    revision.bump()


def announce(keys: Iterable[int]) -> None:
    """Mark the models KEYS, and send a signal after the transaction: their sessions have to follow."""
    changed = sorted(set(keys))
    DeviceModel.objects.filter(pk__in=changed).update(changed=True)
    revision.bump()
    transaction.on_commit(lambda: models_changed.send(sender=DeviceModel, keys=changed))


def mark_all() -> list[int]:
    """Mark every model for a new count of who measured it; their primary keys."""
    DeviceModel.objects.update(changed=True)
    return list(DeviceModel.objects.values_list("pk", flat=True))
