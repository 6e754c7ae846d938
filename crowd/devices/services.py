"""Writes of installations: enrolment, tokens, whether their models are named."""

import hashlib
import secrets
from typing import Any

from django.db import DEFAULT_DB_ALIAS, transaction
from django.db.models import CharField, Q, QuerySet

from crowd.devices import recognition
from crowd.devices.models import DeviceModel, Installation
from crowd.prepared import Placeholder, Query

COLUMNS = [field.attname for field in Installation._meta.concrete_fields]


def enrol(
    app: str, app_version: str, consent_version: int, simulated: bool = False
) -> tuple[Installation, str]:
    """A new installation and its token, which is told this once and then known by its digest alone. A
    SIMULATED one stays so.
    """
    token = secrets.token_urlsafe(32)
    installation = Installation.objects.create(
        token_sha256=_digest(token),
        app=app,
        app_version=app_version,
        consent_version=consent_version,
        simulated=simulated,
    )
    return installation, token


def renew_token(installation: Installation) -> str:
    """A token that takes the place of the present one when it is used first; until then both work.

    An answer that never arrived thus locks nobody out. Of several such tokens only the last works.
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
    known = Installation.objects.filter(Q(token_sha256=digest) | Q(next_token_sha256=digest))
    return known.order_by().values_list(*COLUMNS)


_known = Query(_by_token)


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
