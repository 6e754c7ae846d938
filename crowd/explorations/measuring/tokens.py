"""Tokens of reference devices that measure over HTTP. Only digests are stored."""

import hashlib
import secrets

from django.db import transaction
from django.utils import timezone

from crowd.audit.services import COMMAND_LINE, record
from crowd.explorations.models import ReferenceDevice


@transaction.atomic
def issue_token(device: ReferenceDevice, by: str = COMMAND_LINE) -> str:
    """Issue a new token of `device`. Earlier tokens stop working. The audit log names `by`."""
    token = secrets.token_hex(32)  # never begins with a dash: it follows --token
    device.token_sha256, device.token_issued_at = _digest(token), timezone.now()
    device.save(update_fields=["token_sha256", "token_issued_at"])
    record(by, "token issued", _subject(device))
    return token


@transaction.atomic
def revoke_token(device: ReferenceDevice, by: str = COMMAND_LINE, note: str = "") -> None:
    """Revoke the token of `device`, if it has one. The audit log names `by`."""
    if device.token_sha256 is None:
        return
    device.token_sha256 = device.token_issued_at = None
    device.save(update_fields=["token_sha256", "token_issued_at"])
    record(by, "token revoked", _subject(device), note)


def device_of_token(token: str) -> ReferenceDevice | None:
    """The device with `token`; None if unknown."""
    return ReferenceDevice.objects.filter(token_sha256=_digest(token)).first()


def _subject(device: ReferenceDevice) -> str:
    return f"reference device {device.name}"


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
