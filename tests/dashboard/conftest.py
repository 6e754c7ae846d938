import secrets

import pytest
from django.core.cache import cache

from crowd.devices import revision
from tests.crowd.conftest import front, join, pack, participant

__all__ = ["front", "join", "pack", "participant"]


@pytest.fixture(autouse=True)
def nothing_is_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test has a database of its own, whose revisions have the same numbers, and exports of its own."""
    cache.clear()
    own, current = secrets.token_hex(4), revision.current
    monkeypatch.setattr(revision, "current", lambda: f"{own}-{current()}")
