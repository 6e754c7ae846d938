"""The manifest as bytes: what clients read, and what those who decide see before."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache

import msgspec

from crowd.fronts import responses, selectors
from crowd.fronts.policy import Policy
from crowd.fronts.selectors import Front


@dataclass(frozen=True)
class Manifest:
    """One manifest, the same for everyone, and its ETag."""

    content: bytes
    etag: str


def current(application: str | None, policy: Policy) -> Manifest | None:
    """What clients of APPLICATION (None: of any) measure now; None where no front is published.

    One query, two more after a front or POLICY that this process has not seen: the content of a published
    front is fixed under its digest.
    """
    named = selectors.current_name(application)
    return None if named is None else _made(*named, policy)


@lru_cache(maxsize=32)
def _made(slug: str, digest: str, policy: Policy) -> Manifest:  # noqa: ARG001 - the digest is part of the key
    front = selectors.front(slug)
    assert front is not None  # what was published stays
    made = content(front, policy)
    return Manifest(made, etag(made))


def content(front: Front, policy: Policy) -> bytes:
    """The manifest that asks clients to measure FRONT, byte for byte."""
    return msgspec.json.encode(responses.manifest(front, policy))


def etag(manifest: bytes) -> str:
    """Its ETag: clients that have this one get 304."""
    return f'"{hashlib.sha256(manifest).hexdigest()[:32]}"'
