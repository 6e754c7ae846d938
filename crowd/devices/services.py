"""Writes of installations: enrolment, tokens, their device, consent to show the model."""

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
from crowd.devices.models import DeviceModel, Installation
from crowd.devices.naming.identity import identify
from crowd.http.problems import Problem

# After consenting and withdrawing, a participant can consent again after this time.
CONSENT_PAUSE_SECONDS = 3600

COLUMNS = [field.attname for field in Installation._meta.concrete_fields]


def enrol(app: str, app_version: str, consent_version: int, network: str = "") -> tuple[Installation, str]:
    """Create an installation. Returns it with its token, of which only the digest is stored.

    `network` is a hash from `crowd.access.addresses.network_hash`.
    """
    token = secrets.token_urlsafe(32)
    installation = Installation.objects.create(
        token_sha256=_digest(token),
        app=app,
        app_version=app_version,
        consent_version=consent_version,
        network=network,
    )
    return installation, token


def renew_token(installation: Installation) -> str:
    """A new token that replaces the current one on its first use; until then both work.

    So a lost answer does not lock the client out. Of several new tokens, only the last works.
    """
    token = secrets.token_urlsafe(32)
    Installation.objects.filter(pk=installation.pk).update(next_token_sha256=_digest(token))
    return token


def installation_of(token: str) -> Installation | None:
    """The installation with `token`, also if revoked; None for an unknown or replaced token. One query."""
    digest = _digest(token)
    rows = _by_token_query.rows(digest=digest)
    if not rows:
        return None
    installation = Installation.from_db(DEFAULT_DB_ALIAS, COLUMNS, rows[0])
    if installation.next_token_sha256 == digest:
        Installation.objects.filter(next_token_sha256=digest).update(
            token_sha256=digest, next_token_sha256=None
        )
    return installation


def bind_device(installation: Installation, description: int, raw: Mapping[str, Any], network: str) -> None:
    """Bind `installation` to the device of its first description, and store its `network` if unknown.

    `description` is the primary key of `raw`. No query if both are stored already. Raises Problem 409 if
    `raw` describes another device.
    """
    changes: dict[str, Any] = {}
    if installation.description_id != description:
        check_device(installation, raw)
        if installation.description_id is None:
            changes["description_id"] = description
    if network and not installation.network:
        changes["network"] = network
    if not changes:
        return
    rows = Installation.objects.filter(pk=installation.pk)
    if "description_id" in changes:
        rows = rows.filter(description=None)
    if not rows.update(**changes):
        # Another request bound the installation meanwhile, or it was erased.
        current = Installation.objects.filter(pk=installation.pk).first()
        if current is not None:
            bind_device(current, description, raw, network)


def check_device(installation: Installation, raw: Mapping[str, Any]) -> None:
    """Raises Problem 409 if `raw` describes another device than that of `installation`. One query.

    System, driver and computing chip may change.
    """
    if installation.description is None:
        return
    enrolled, described = identify(installation.description.raw), identify(raw)
    if enrolled.machine != described.machine:
        raise Problem(
            "device_changed",
            f"this installation measures on {enrolled.manufacturer} {enrolled.name}, not on "
            f"{described.manufacturer} {described.name}: enrol again for a second device",
            field="device",
        )


@transaction.atomic(savepoint=False)
def choose_disclosure(installation: Installation, show_model: bool | None) -> int:
    """Store whether the models of `installation` are named even if rare; None changes nothing.

    It takes effect at once; sessions do not change. Open data files are rewritten, so showing a name is
    possible once an hour; hiding it is always possible. Returns 0 if the choice is stored, otherwise the
    seconds to wait.
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
    """Count a consent of `installation`.

    Returns the seconds to wait if it consented within the hour, else 0.
    """
    with counters.tolerate_failure("changes of disclosure"):
        count = counters.count(f"agreed:{installation.pk}", CONSENT_PAUSE_SECONDS)
        return math.ceil(max(count.resets_in, 1)) if count.used > 1 else 0
    return 0


@transaction.atomic
def refresh_disclosure(key: int) -> bool:
    """Count the installations of the model `key` and their consent.

    Returns whether its public name changed.
    """
    # The lock makes the last counter see what earlier ones stored.
    model = DeviceModel.objects.select_for_update(no_key=True).filter(pk=key).first()
    if model is None:
        return False
    enough = max(1, settings.FRONTRUNNER_RARE_BELOW)
    sessions = model.sessions.order_by()
    installations = sessions.values_list("installation_id", flat=True).distinct()[:enough]
    rare = disclosure.is_rare(len(installations))
    consented = (
        rare and len(installations) > 0 and not sessions.filter(installation__show_model=False).exists()
    )
    if (rare, consented) == (model.rare, model.consented):
        return False
    before = disclosure.is_disclosed(model)
    model.rare, model.consented = rare, consented
    model.save(update_fields=["rare", "consented"])
    revision.bump()
    return before != disclosure.is_disclosed(model)


def withdraw_consent(key: int) -> None:
    """Mask the model `key`: one of its participants no longer agrees."""
    DeviceModel.objects.filter(pk=key).update(consented=False)
    revision.bump()


def _by_token() -> "QuerySet[Installation, tuple[Any, ...]]":
    digest = Placeholder("digest", CharField())
    matches = Installation.objects.filter(Q(token_sha256=digest) | Q(next_token_sha256=digest))
    return matches.order_by().values_list(*COLUMNS)


_by_token_query = CompiledQuery(_by_token)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
