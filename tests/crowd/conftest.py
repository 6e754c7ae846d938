import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.celery import app
from crowd.devices.models import Installation
from crowd.devices.services import enrol
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import create_draft, publish_content
from tests.builders.crowds import Join
from tests.builders.documents import front_document, write_pack
from tests.builders.participant import Participant
from tests.crowd.buckets import *  # noqa: F403 - its fixtures
from tests.server import *  # noqa: F403 - its fixtures


@pytest.fixture
def pack(own_data_folder: Path) -> dict[str, Any]:
    return write_pack(own_data_folder / "sequences")


@pytest.fixture
def front(db: None, pack: dict[str, Any]) -> FrontVersion:
    """A published front kfusion-test with default, best and accurate."""
    return publish_content(front_document(pack))[0]


@pytest.fixture
def draft(db: None, pack: dict[str, Any]) -> FrontVersion:
    """A draft by anna of a front that has no published version."""
    return create_draft(front_document(pack, version="1"), by="anna")


@pytest.fixture
def join(client: Client) -> Join:
    """Enrols one more participant, from its own network unless it names one."""

    def enrolled(network: str = "") -> Participant:
        installation, token = enrol("client_kit", "0.1.0", 1, network=network or secrets.token_hex(16))
        return Participant(client, token, str(installation.pk))

    return enrolled


@pytest.fixture
def participant(front: FrontVersion, join: Join) -> Participant:
    """An enrolled participant of a server with a published front."""
    return join()


@pytest.fixture
def installation(participant: Participant) -> Installation:
    return Installation.objects.get(pk=participant.installation_id)


@pytest.fixture
def no_worker() -> Iterator[None]:
    """Messages are sent, but no worker takes them."""
    app.conf.task_always_eager = False
    yield
    app.conf.task_always_eager = True


@pytest.fixture
def rare_below_five(settings: Any) -> None:
    """A model has its name in public once five installations measured it."""
    settings.FRONTRUNNER_RARE_BELOW = 5
