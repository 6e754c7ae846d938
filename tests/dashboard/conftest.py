import secrets
from typing import Any

import pytest
from django.core.cache import cache

from crowd.devices import revision
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from tests.builders.documents import front_document
from tests.crowd.conftest import front, join, pack, participant
from tests.server import *  # noqa: F403 - its fixtures

__all__ = ["front", "join", "pack", "participant"]


@pytest.fixture
def long_front(db: None, pack: dict[str, Any]) -> FrontVersion:
    """A published front whose sessions have four pairs: enough for an interval of their own."""
    return publish_content(front_document(pack, "long", pairs=4))[0]


@pytest.fixture(autouse=True)
def nothing_is_cached(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test has a database of its own, whose revisions have the same numbers, and exports of its own."""
    cache.clear()
    own, current = secrets.token_hex(4), revision.current
    monkeypatch.setattr(revision, "current", lambda: f"{own}-{current()}")
