"""Writes of installations: enrolment, tokens, their device, whether their models are named."""

import hashlib
import math
import secrets
from collections.abc import Mapping
from typing import Any

from django.conf import settings
from django.db import DEFAULT_DB_ALIAS, transaction
from django.db.models import CharField, Q, QuerySet

from crowd.access import counters
from crowd.database.prepared import CompiledQuery, Placeholder
from crowd.devices import disclosure, revision
from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.devices.naming.normalisation import identify
from crowd.http.problems import Problem

# How long a participant who agreed, and then did not, waits to agree again.
AGREED_SECONDS = 3600

COLUMNS = [field.attname for field in Installation._meta.concrete_fields]


def enrol(
    app: str, app_version: str, consent_version: int, simulated: bool = False, network: str = ""
) -> tuple[Installation, str]:
    """A new installation and its token, which is shown this once; only its digest is kept. A SIMULATED one
    stays so. NETWORK is the keyed hash of where it enrols from (`crowd.access.addresses.network_of`).
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
    """The installation with TOKEN, also a revoked one; None for an unknown or replaced token. One query."""
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
    if known.machine != described.machine:
        raise Problem(
            "device_changed",
            f"this installation measures on {known.manufacturer} {known.name}, not on "
            f"{described.manufacturer} {described.name}: enrol again for a second device",
            field="device",
        )


@transaction.atomic(savepoint=False)
def choose_disclosure(installation: Installation, show_model: bool | None) -> int:
    """Agree that the models of INSTALLATION are named however rare they are, or do not; None: as before.

    It takes effect at once and changes no session. Files of the open data are rewritten for it, so the name
    is shown again at most once an hour; it can be hidden at any time. Answers how many seconds there are left
    until the name can be shown again, 0 where the choice is stored.
    """
    if show_model is None or show_model == installation.show_model:
        return 0
    if show_model and (wait := _seconds_to_agree(installation)):
        return wait
    installation.show_model = show_model
    installation.save(update_fields=["show_model"])
    for model in DeviceModel.objects.filter(sessions__installation=installation, rare=True).distinct():
        refresh_disclosure(model.pk)
    return 0


def _seconds_to_agree(installation: Installation) -> int:
    """How long INSTALLATION, which agreed within the hour already, has to wait; else 0. Counts this time."""
    with counters.counting("changes of disclosure"):
        count = counters.count(f"agreed:{installation.pk}", AGREED_SECONDS)
        return math.ceil(max(count.resets_in, 1)) if count.used > 1 else 0
    return 0


@transaction.atomic
def refresh_disclosure(key: int) -> bool:
    """Count who measured the model KEY, and whether all of them agreed to its name; whether that changed what
    the public sees.
    """
    # The last to count sees what those before stored.
    model = DeviceModel.objects.select_for_update(no_key=True).filter(pk=key).first()
    if model is None:
        return False
    enough = max(1, settings.FRONTRUNNER_RARE_BELOW)
    sessions = model.sessions.order_by()
    known = sessions.values_list("installation_id", flat=True).distinct()[:enough]
    rare = model.kind != DeviceModel.Kind.SIMULATED and disclosure.is_rare(len(known))
    consented = rare and len(known) > 0 and not sessions.filter(installation__show_model=False).exists()
    if (rare, consented) == (model.rare, model.consented):
        return False
    before = disclosure.is_disclosed(model)
    model.rare, model.consented = rare, consented
    model.save(update_fields=["rare", "consented"])
    revision.bump()
    return before != disclosure.is_disclosed(model)


def withdraw_consent(key: int) -> None:
    """The model KEY was named because all agreed; now one does not."""
    DeviceModel.objects.filter(pk=key).update(consented=False)
    revision.bump()


def _by_token() -> "QuerySet[Installation, tuple[Any, ...]]":
    digest = Placeholder("digest", CharField())
    known = Installation.objects.filter(Q(token_sha256=digest) | Q(next_token_sha256=digest))
    return known.order_by().values_list(*COLUMNS)


_known = CompiledQuery(_by_token)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
