"""The manifest as bytes: what clients read, and what those who decide see before."""

import hashlib

import msgspec
from django.conf import settings

from crowd.fronts import answers
from crowd.fronts.selectors import Front


def content(front: Front) -> bytes:
    """The manifest that tells clients to measure FRONT, byte for byte."""
    return msgspec.json.encode(
        answers.manifest(
            front,
            consent_version=settings.FRONTRUNNER_CONSENT_VERSION,
            minimum_app_version=settings.FRONTRUNNER_MINIMUM_APP_VERSION,
            accepting=settings.FRONTRUNNER_ACCEPTING,
        )
    )


def etag(manifest: bytes) -> str:
    """Its ETag: clients that have this one are told that nothing changed."""
    return f'"{hashlib.sha256(manifest).hexdigest()[:32]}"'


def indented(manifest: bytes) -> str:
    """The same members for people to read."""
    return msgspec.json.format(manifest, indent=2).decode()
