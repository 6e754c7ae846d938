import secrets
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import pytest
from django.core.cache import cache

from crowd.devices import revision
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from tests.builders import stored
from tests.builders.documents import front_document
from tests.builders.measuring import measure
from tests.crowd.conftest import front, join, pack, participant
from tests.server import *  # noqa: F403 - its fixtures

__all__ = ["front", "join", "pack", "participant"]

Filling = Callable[..., AbstractContextManager[dict[str, Any]]]


@pytest.fixture(scope="module")
def filling(
    django_db_setup: None, django_db_blocker: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Filling]:
    """`with filling(**settings) as pack`: what is stored there, all tests of the module find."""
    yield lambda **settings: stored.filling(django_db_blocker, tmp_path_factory.mktemp("stored"), **settings)
    with django_db_blocker.unblock():
        stored.empty()


@pytest.fixture(scope="module")
def session(filling: Filling) -> dict[str, Any]:
    """What all tests of the module find: the front kfusion-test, measured once on a Pixel 8: 8 times as fast.
    As it was sent.
    """
    with filling() as pack:
        publish_content(front_document(pack))
        return measure(stored.join())


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
