"""Writes of installations: enrolment, tokens, their device, whether their models are named."""

import hashlib
import secrets
from collections.abc import Mapping
from typing import Any

from django.db import DEFAULT_DB_ALIAS, transaction
from django.db.models import CharField, Q, QuerySet

from crowd.devices import recognition
from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.devices.normalisation import identify
from crowd.prepared import Placeholder, Query
from crowd.problems import Problem

COLUMNS = [field.attname for field in Installation._meta.concrete_fields]


def enrol(
    app: str, app_version: str, consent_version: int, simulated: bool = False, network: str = ""
) -> tuple[Installation, str]:
    """A new installation and its token, which is shown this once; only its digest is kept. A SIMULATED one
    stays so. NETWORK is the keyed hash of where it enrols from (`crowd.limits.network_of`).
    """
    token = secrets.token_urlsafe(32)
    installation = Installation.objects.create(
        token_sha256=_digest(token),
        app=app,
        app_version=app_version,
        consent_version=consent_version,
        simulated=simulated,
        network=network,
    )
    return installation, token


def renew_token(installation: Installation) -> str:
    """A token that replaces the present one at its first use; until then both work.

    So an answer that never arrives does not lock anybody out. Of several such tokens only the last works.
    """
    token = secrets.token_urlsafe(32)
    Installation.objects.filter(pk=installation.pk).update(next_token_sha256=_digest(token))
    return token


def installation_of(token: str) -> Installation | None:
    """Whose TOKEN it is; None for one that is unknown, was followed by another or revoked. One query."""
    digest = _digest(token)
    found = _known.rows(digest=digest)
    if not found:
        return None
    installation = Installation.from_db(DEFAULT_DB_ALIAS, COLUMNS, found[0])
    if installation.next_token_sha256 == digest:
        Installation.objects.filter(next_token_sha256=digest).update(
            token_sha256=digest, next_token_sha256=None
        )
    return installation


def bind_device(installation: Installation, description: int, raw: Mapping[str, Any], network: str) -> None:
    """Bind INSTALLATION to the device of its first description, and note its NETWORK where none is known.

    DESCRIPTION is the primary key of RAW's row. No query where it is the first one, and the network is known.
    Raises Problem 409 where RAW describes another device.
    """
    changes: dict[str, Any] = {}
    if installation.description_id != description:
        first = _first_description(installation)
        _refuse_another_device(installation, first, raw)
        if installation.description_id is None:
            changes["description_id"] = description if first is None else first.pk
    if network and not installation.network and not installation.simulated:
        changes["network"] = network
    if not changes:
        return
    rows = Installation.objects.filter(pk=installation.pk)
    if "description_id" in changes:
        rows = rows.filter(description=None)
    if not rows.update(**changes):
        # Another request bound it meanwhile, or it was erased.
        present = Installation.objects.filter(pk=installation.pk).first()
        if present is not None:
            bind_device(present, description, raw, network)


def check_device(installation: Installation, raw: Mapping[str, Any]) -> None:
    """Raises Problem 409 where RAW describes another device than that of INSTALLATION. One query."""
    _refuse_another_device(installation, _first_description(installation), raw)


def _first_description(installation: Installation) -> DeviceDescription | None:
    """How the device of INSTALLATION described itself first; None before its first session."""
    if installation.description_id is not None:
        return DeviceDescription.objects.filter(pk=installation.description_id).first()
    # Installations from before that column have their sessions alone.
    earlier = DeviceDescription.objects.filter(sessions__installation=installation)
    return earlier.order_by("sessions__pk").first()


def _refuse_another_device(
    installation: Installation, first: DeviceDescription | None, raw: Mapping[str, Any]
) -> None:
    """By the present rules: a device may change its system, driver, or the chip that computes."""
    if first is None:
        return
    known, described = identify(first.raw, installation.simulated), identify(raw, installation.simulated)
    if known.key != described.key:
        raise Problem(
            409,
            "device_changed",
            f"this installation measures on {known.manufacturer} {known.name}, not on "
            f"{described.manufacturer} {described.name}: enrol again for a second device",
            field="device",
        )


@transaction.atomic(savepoint=False)
def choose_disclosure(installation: Installation, show_model: bool | None) -> None:
    """Name the models of INSTALLATION however rare they are, or do not; None: as before.

    Its earlier sessions follow in a task.
    """
    if show_model is None or show_model == installation.show_model:
        return
    installation.show_model = show_model
    installation.save(update_fields=["show_model"])
    recognition.announce(
        DeviceModel.objects.filter(descriptions__sessions__installation=installation).values_list(
            "pk", flat=True
        )
    )


def _by_token() -> "QuerySet[Installation, tuple[Any, ...]]":
    digest = Placeholder("digest", CharField())
    known = Installation.objects.filter(Q(token_sha256=digest) | Q(next_token_sha256=digest), revoked_at=None)
    return known.order_by().values_list(*COLUMNS)


_known = Query(_by_token)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
