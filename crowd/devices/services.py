"""Writes of devices: enrolment of an installation, recognition of the model behind raw strings."""

import hashlib
import secrets
from typing import Any

import msgspec
from django.db import transaction

from crowd.devices import normalisation
from crowd.devices.models import DeviceDescription, DeviceModel, Installation


def enrol(app: str, app_version: str, consent_version: int) -> tuple[Installation, str]:
    """A new installation and its token, which is told this once and then known by its digest alone."""
    token = secrets.token_urlsafe(32)
    installation = Installation.objects.create(
        token_sha256=_digest(token), app=app, app_version=app_version, consent_version=consent_version
    )
    return installation, token


def installation_of(token: str) -> Installation | None:
    """Whose TOKEN it is; None for one that is unknown or revoked. One query."""
    return Installation.objects.filter(token_sha256=_digest(token), revoked_at=None).first()


@transaction.atomic
def recognise(raw: dict[str, Any]) -> DeviceDescription:
    """The stored description equal to RAW, and through it the model; both are made on first sight."""
    digest = hashlib.sha256(msgspec.json.encode(raw, order="sorted")).hexdigest()
    known = DeviceDescription.objects.select_related("model").filter(digest=digest).first()
    if known is not None:
        return known
    description, _ = DeviceDescription.objects.get_or_create(
        digest=digest, defaults={"raw": raw, "model": _model(normalisation.identify(raw))}
    )
    return description


def _model(identity: normalisation.Identity) -> DeviceModel:
    """The model with the identity's key. Parts that an earlier device did not tell are filled in."""
    taken = DeviceModel.objects.filter(slug=identity.slug).exclude(key=identity.key).exists()
    slug = (
        normalisation.slug_of(identity.manufacturer, identity.name, identity.key) if taken else identity.slug
    )
    parts = {"cpu": identity.cpu, "soc": identity.soc, "gpu": identity.gpu, "os": identity.os}
    model, new = DeviceModel.objects.get_or_create(
        key=identity.key,
        defaults={"slug": slug, "manufacturer": identity.manufacturer, "name": identity.name, **parts},
    )
    missing = {part: value for part, value in parts.items() if value and not getattr(model, part)}
    if not new and missing:
        for part, value in missing.items():
            setattr(model, part, value)
        model.save(update_fields=list(missing))
    return model


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
