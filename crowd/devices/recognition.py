"""Finds or creates the model behind raw strings, and derives it again when rules or the catalogue change."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import msgspec
from django.db import transaction
from django.db.models import CharField, QuerySet

from crowd.database.prepared import CompiledQuery, Placeholder
from crowd.devices import catalogue, disclosure, revision
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.devices.naming import chips, computing
from crowd.devices.naming.identity import RULES, Identity, identity_of
from crowd.devices.naming.raw_device import RawDevice
from crowd.devices.signals import models_changed

PARTS = ("cpu", "soc", "gpu", "os", "market_name")
COLUMNS = ("pk", "rare", "consented", "soc", "cpu")  # of a model, that a session needs
BATCH = 200


@dataclass(frozen=True)
class RecognisedDevice:
    """What a new session needs to know about its device.

    `description` and `model` are primary keys; sessions count for `model`. `named_by_consent`: the model is
    rare and named because all its participants agreed. `central_processor` computes with backends
    of ON_PROCESSOR, `processor` with any other.
    """

    description: int
    model: int
    named_by_consent: bool
    driver: str
    processor: str
    processor_class: str
    central_processor: str

    def computed_by(self, backend: str) -> tuple[str, str]:
        """The chip that computes with `backend`, and its class."""
        if backend in computing.ON_PROCESSOR:
            return self.central_processor, chips.CPU
        return self.processor, self.processor_class


def recognise(raw: dict[str, Any]) -> RecognisedDevice:
    """The device behind `raw`. A new description and its model are stored; a known one takes one query."""
    digest = hashlib.sha256(msgspec.json.encode(raw, order="sorted")).hexdigest()
    device = _find(digest)
    if device is None:
        _store_description(raw, digest)
        device = _find(digest)
        assert device is not None  # it was stored above
    return device


def _find(digest: str) -> RecognisedDevice | None:
    for key, driver, version, processor, kind, *models in _by_digest_query.rows(digest=digest):
        own, canonical = models[: len(COLUMNS)], models[len(COLUMNS) :]
        model, rare, consented, soc, cpu = own if canonical[0] is None else canonical
        return RecognisedDevice(
            key,
            model,
            rare and consented,
            f"{driver} {version}".strip(),
            processor,
            kind,
            computing.central_processor(soc, cpu),
        )
    return None


def _by_digest() -> "QuerySet[DeviceDescription, tuple[Any, ...]]":
    rows = DeviceDescription.objects.filter(digest=Placeholder("digest", CharField()))
    shown = (f"model__{path}{name}" for path in ("", "canonical__") for name in COLUMNS)
    return rows.order_by().values_list(
        "pk", "driver_name", "driver_version", "processor", "processor_class", *shown
    )


_by_digest_query = CompiledQuery(_by_digest)


@transaction.atomic
def _store_description(raw: dict[str, Any], digest: str) -> None:
    """Store the description `raw` and its model."""
    identity, entry, computed_by = _derive(raw)
    DeviceDescription.objects.get_or_create(
        digest=digest,
        defaults={
            "raw": raw,
            "model": _model(identity, entry),
            "rules": RULES,
            **computed_by,
        },
    )


def renormalise_waiting(limit: int = BATCH) -> int:
    """Derive at most `limit` descriptions of older rules again. Returns their number."""
    waiting = DeviceDescription.objects.filter(rules__lt=RULES).order_by("pk")[:limit]
    return renormalise(DeviceDescription.objects.filter(pk__in=list(waiting.values_list("pk", flat=True))))


@transaction.atomic
def renormalise(descriptions: QuerySet[DeviceDescription]) -> int:
    """Derive models and drivers of `descriptions` again. Returns the number of descriptions.

    Decisions of administrators stay. If all descriptions of a model get the same new name, and it is free,
    the model is renamed; it keeps its address, aliases and sessions. Otherwise descriptions move to other
    models, and a task moves their sessions. All descriptions of an affected model are derived, not only those
    given.
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
        mark_changed(touched)
    return len(rows)


def _rederive(described: list[DeviceDescription]) -> set[int]:
    """Derive the descriptions of one model again. Returns keys of models whose sessions or figures change."""
    old = described[0].model
    derived = [(row, *_derive(row.raw)) for row in described]
    ruled = [identity for row, identity, _, _ in derived if row.split_id is None]
    keys = {identity.key for identity in ruled}
    renamed = len(keys) == 1 and old.key not in keys
    if renamed and not DeviceModel.objects.filter(key__in=keys).exists():
        old.key, old.manufacturer, old.name = ruled[0].key, ruled[0].manufacturer, ruled[0].name
        old.save(update_fields=["key", "manufacturer", "name"])
    touched: set[int] = set()
    reset: dict[int, DeviceModel] = {}
    before: dict[int, tuple[Any, ...]] = {}
    for row, identity, entry, computed_by in derived:
        model = old if row.split_id is not None else _model(identity, entry)
        if model.pk not in reset:
            before[model.pk] = _seen_by_sessions(model)
            _reset_parts(model, identity, entry)
            reset[model.pk] = model
        _fill_missing(reset[model.pk], identity, entry)
        if model.pk != row.model_id or row.processor != computed_by["processor"]:
            touched |= {model.pk, row.model_id}
        row.model, row.rules = reset[model.pk], RULES
        for name, value in computed_by.items():
            setattr(row, name, value)
        row.save(update_fields=["model", "rules", *computed_by])
    return touched | {key for key, model in reset.items() if _seen_by_sessions(model) != before[key]}


def _seen_by_sessions(model: DeviceModel) -> tuple[Any, ...]:
    """What sessions and figures of `model` depend on."""
    return model.kind, model.named, computing.central_processor(model.soc, model.cpu)


def _derive(raw: dict[str, Any]) -> tuple[Identity, catalogue.Entry, dict[str, str]]:
    """Identity and catalogue entry of `raw`, and the columns of its driver and processor."""
    device = RawDevice.parse(raw)
    driver, processor = computing.driver(device), computing.processor_of(device)
    computed_by = {
        "driver_name": driver.name,
        "driver_version": driver.version[:50],
        "processor": processor.name[:200],
        "processor_class": processor.kind,
    }
    identity = identity_of(device, processor)
    return identity, catalogue.look_up(device), computed_by


def _model(identity: Identity, entry: catalogue.Entry) -> DeviceModel:
    """The model with the key of `identity`, created if needed. Missing parts are filled in."""
    model, new = DeviceModel.objects.get_or_create(
        key=identity.key,
        defaults={
            "slug": _free_slug(identity),
            "manufacturer": identity.manufacturer,
            "name": identity.name,
            "kind": identity.kind,
            "named": identity.named or bool(entry.market_name),
            "rare": disclosure.is_rare(1),
            "changed": False,
            **_parts(identity, entry),
        },
    )
    before = _seen_by_sessions(model)
    if not new:
        _fill_missing(model, identity, entry)
    if _seen_by_sessions(model) != before:
        mark_changed([model.pk])
    return model


def _free_slug(identity: Identity) -> str:
    taken = DeviceModel.objects.filter(slug=identity.slug).exclude(key=identity.key).exists()
    return identity.distinct_slug if taken else identity.slug


def _parts(identity: Identity, entry: catalogue.Entry) -> dict[str, str]:
    """The parts that the device reports; the catalogue fills in missing ones."""
    return {
        "cpu": identity.cpu,
        "soc": identity.soc or entry.soc,
        "gpu": _more_specific(identity.gpu, entry.gpu),
        "os": identity.os,
        "market_name": entry.market_name,
    }


def _more_specific(gpu: str, other: str) -> str:
    """GPU, or `other` if GPU is unknown or only names a family."""
    return other if other and (not gpu or (chips.is_one_chip(other) and not chips.is_one_chip(gpu))) else gpu


def _fill_missing(model: DeviceModel, identity: Identity, entry: catalogue.Entry) -> None:
    missing = {
        part: text for part, text in _parts(identity, entry).items() if text and not getattr(model, part)
    }
    if (gpu := _more_specific(model.gpu, identity.gpu)) != model.gpu:
        missing["gpu"] = gpu
    if missing:
        for part, value in missing.items():
            setattr(model, part, value)
        model.named = model.named or bool(model.market_name)
        model.save(update_fields=[*missing, "named"])
        revision.bump()


def _reset_parts(model: DeviceModel, identity: Identity, entry: catalogue.Entry) -> None:
    """Replace the parts of `model` by older rules. A kind that an administrator set stays."""
    for part, value in _parts(identity, entry).items():
        setattr(model, part, value)
    if not model.judged_by:
        model.kind = identity.kind
        model.named = identity.named or bool(entry.market_name)
    if not identity.named:
        # Older rules made slugs from strings of devices.
        model.slug = _free_slug(identity)
    model.save(update_fields=[*PARTS, "kind", "named", "slug"])
    revision.bump()


def mark_changed(keys: Iterable[int]) -> None:
    """Mark the models `keys` as changed, and send `models_changed` after the transaction."""
    changed = sorted(set(keys))
    DeviceModel.objects.filter(pk__in=changed).update(changed=True)
    revision.bump()
    transaction.on_commit(lambda: models_changed.send(sender=DeviceModel, keys=changed))


def mark_all_changed() -> list[int]:
    """Mark every model as changed. Returns their primary keys."""
    DeviceModel.objects.update(changed=True)
    return list(DeviceModel.objects.values_list("pk", flat=True))
