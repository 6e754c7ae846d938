"""Manifests as bytes, with caching."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache

import msgspec

from crowd.fronts import responses, selectors
from crowd.fronts.content import plans
from crowd.fronts.intake_policy import Policy
from wire.front import Front


class OutdatedFrontError(Exception):
    """The current front was prepared with another program; the message names it."""


@dataclass(frozen=True)
class Manifest:
    """A manifest, the same for all clients, with its ETag."""

    content: bytes
    etag: str


def current(application: str | None, policy: Policy) -> Manifest | None:
    """The current manifest of `application` (None: of any); None if no front is published.

    One query, and two more for a front or `policy` that this process has not cached. The digest fixes the
    content of a front. Raises OutdatedFrontError.
    """
    named = selectors.current_name(application)
    return None if named is None else _build(*named, policy)


@lru_cache(maxsize=32)
def _build(slug: str, digest: str, policy: Policy) -> Manifest:  # noqa: ARG001 - the digest is part of the key
    front = selectors.front(slug)
    assert front is not None  # published fronts are never deleted
    require_current_program(front)
    made = content(front, policy)
    return Manifest(made, etag(made))


def require_current_program(front: Front) -> None:
    """Raise OutdatedFrontError if clients of this program compute something else than `front`'s
    references."""
    if plans.outdated(front):
        raise OutdatedFrontError(
            f"{front.slug} was prepared with an earlier version of the program: it is offered again once an "
            "administrator has prepared it again"
        )


def content(front: Front, policy: Policy) -> bytes:
    """The manifest of `front` as JSON."""
    return msgspec.json.encode(responses.manifest(front, policy))


def etag(manifest: bytes) -> str:
    """The ETag of `manifest`."""
    return f'"{hashlib.sha256(manifest).hexdigest()[:32]}"'
