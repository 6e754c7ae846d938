"""A front with probes, and participants whose devices have costs of their own for each stage."""

from collections.abc import Iterator
from typing import Any

import pytest

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.predictions import maps
from tests.builders import stored
from tests.builders.crowds import Join
from tests.builders.known_front import known_front
from tests.builders.measured import MALI, Measured
from tests.crowd.conftest import join
from tests.server import *  # noqa: F403 - its fixtures
from tests.shipped import FIXTURES

__all__ = ["join"]


@pytest.fixture(scope="session")
def document() -> dict[str, Any]:
    return known_front()


@pytest.fixture(scope="module")
def published(
    django_db_setup: None,
    django_db_blocker: Any,
    tmp_path_factory: pytest.TempPathFactory,
    document: dict[str, Any],
) -> Iterator[None]:
    """All tests of a module find the front."""
    sequences = {"FRONTRUNNER_SEQUENCES": [FIXTURES / "sequences"]}
    with stored.filling(django_db_blocker, tmp_path_factory.mktemp("stored"), **sequences):
        publish_content(document)
    yield
    with django_db_blocker.unblock():
        stored.empty()


@pytest.fixture
def front(published: None, db: None, settings: Any) -> FrontVersion:
    settings.FRONTRUNNER_SEQUENCES = [FIXTURES / "sequences"]
    maps._reference_belief.cache_clear()
    return FrontVersion.objects.get()


@pytest.fixture
def measured(
    front: FrontVersion,
    join: Join,
    document: dict[str, Any],
) -> Any:
    """One more participant, whose DEVICE with CHIP measures default, best and PROBES."""

    def made(device: str = "Pixel 8", chip: str = MALI, **changes: Any) -> Measured:
        one = Measured(join(), document, device, chip, **changes)
        one.send()
        return one

    return made
