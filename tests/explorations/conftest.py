"""A tiny sequence, a small space and explorations over them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from django.contrib.auth import get_user_model
from django.test import Client

from crowd.celery import app
from crowd.explorations import services
from crowd.explorations.models import Exploration
from slam.datasets import open_sequence
from tests.builders.boards import Board
from tests.builders.explorations import run_to_the_end, unsaved_exploration
from tests.server import *  # noqa: F403 - its fixtures
from tests.slam.tiny import write_tiny_pack

MORE = ("desk", "attic", "library")


@pytest.fixture(scope="session")
def tiny_pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence that is measured in a moment."""
    return write_tiny_pack(tmp_path_factory.mktemp("sequences"))


@pytest.fixture(scope="session")
def more_packs(tiny_pack: Path) -> dict[str, dict[str, str]]:
    """Name and digest of further sequences beside the tiny one."""
    digests = {name: open_sequence(write_tiny_pack(tiny_pack.parent, name=name)).sha256 for name in MORE}
    return {name: {"name": name, "sha256": digest} for name, digest in digests.items()}


@pytest.fixture
def unsaved(db: None, tiny_pack: Path, settings: Any) -> Exploration:
    """An exploration that could be created, over the small space and the tiny sequence."""
    settings.FRONTRUNNER_SEQUENCES = [tiny_pack.parent]
    return unsaved_exploration({"name": "tiny", "sha256": open_sequence(tiny_pack).sha256})


@pytest.fixture
def exploration(unsaved: Exploration) -> Exploration:
    """A created one: its known configurations wait."""
    return services.create(unsaved)


@pytest.fixture
def explored(exploration: Exploration) -> Exploration:
    """A finished one: everything it asked for was measured."""
    return run_to_the_end(exploration)


@pytest.fixture
def several(unsaved: Exploration, more_packs: dict[str, dict[str, str]]) -> Exploration:
    """One that could be created, which learns on tiny, desk and attic; library is held out."""
    unsaved.further_sequences = [more_packs["desk"], more_packs["attic"]]
    unsaved.held_out_sequences = [more_packs["library"]]
    return unsaved


@pytest.fixture
def board(client: Client, exploration: Exploration) -> Board:
    """The device of an exploration whose known configurations wait."""
    return Board(client, exploration.reference_device)


@pytest.fixture
def administrator(client: Client, db: None) -> Client:
    """A browser in which the superuser root is logged in."""
    client.force_login(get_user_model().objects.create_superuser("root", "", "a password"))
    return client


@pytest.fixture
def committing(django_capture_on_commit_callbacks: Any) -> Any:
    """A with statement at whose end the transaction counts as stored: what waits for that is done."""
    return lambda: django_capture_on_commit_callbacks(execute=True)


@pytest.fixture
def unread_queues() -> Iterator[None]:
    """Tasks are sent to queues without a worker; those of earlier tests are gone."""
    with app.connection_for_write() as broker:
        for name in ("bench", "crowd"):
            broker.SimpleQueue(name).clear()
    app.conf.update(task_always_eager=False)
    yield
    app.conf.update(task_always_eager=True)
