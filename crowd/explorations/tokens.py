"""The token by which a machine without Celery serves as a reference device. Only its digest is kept."""

import hashlib
import secrets

from django.utils import timezone

from crowd.explorations.models import ReferenceDevice


def issue_token(device: ReferenceDevice) -> str:
    """A new token of DEVICE, told this once; an earlier one no longer works."""
    token = secrets.token_urlsafe(32)
    device.token_sha256, device.token_issued_at = _digest(token), timezone.now()
    device.save(update_fields=["token_sha256", "token_issued_at"])
    return token


def revoke_token(device: ReferenceDevice) -> None:
    """Nobody serves as DEVICE over HTTP any more, until a new token is issued."""
    device.token_sha256 = device.token_issued_at = None
    device.save(update_fields=["token_sha256", "token_issued_at"])


def device_of(token: str) -> ReferenceDevice | None:
    """Whose token that is, None where it is nobody's."""
    return ReferenceDevice.objects.filter(token_sha256=_digest(token)).first()


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
