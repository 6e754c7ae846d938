"""A front with probes, and participants whose devices have costs of their own for each stage."""

from collections.abc import Callable
from typing import Any

import pytest

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.predictions import maps
from tests.builders.known_front import known_front
from tests.builders.measured import MALI, Measured
from tests.builders.participant import Participant
from tests.crowd.conftest import join
from tests.server import *  # noqa: F403 - its fixtures
from tests.shipped import FIXTURES

__all__ = ["join"]


@pytest.fixture(scope="session")
def document() -> dict[str, Any]:
    return known_front()


@pytest.fixture
def front(db: None, settings: Any, document: dict[str, Any]) -> FrontVersion:
    settings.FRONTRUNNER_SEQUENCES = [FIXTURES / "sequences"]
    maps._reference_belief.cache_clear()
    return publish_content(document)[0]


@pytest.fixture
def measured(
    front: FrontVersion,
    join: Callable[[], Participant],
    document: dict[str, Any],
) -> Any:
    """One more participant, whose DEVICE with CHIP measures default, best and PROBES."""

    def made(device: str = "Pixel 8", chip: str = MALI, **changes: Any) -> Measured:
        one = Measured(join(), document, device, chip, **changes)
        one.send()
        return one

    return made
