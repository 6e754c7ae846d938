"""A broker that answers, but takes no messages, is named: clients and workers see no error of their own."""

from pathlib import Path

import pytest
import redis as redis_client

from crowd.operations.broker import FULL
from tests.services.program import ROOT
from tests.services.rabbitmq import RabbitMQ
from tests.services.redis import Redis
from tests.services.serving import shell

STATE = "from crowd.operations import broker; print(broker.state())"
# Less than RabbitMQ uses when it starts.
MEMORY_LIMIT = "vm_memory_high_watermark.absolute = 1MB\n"


def test_a_full_redis_is_named(tmp_path: Path, redis: Redis) -> None:
    assert shell(tmp_path, STATE, CELERY_BROKER_URL=redis.url) == "ok\n"

    redis_client.Redis.from_url(redis.url).config_set("maxmemory", "1")

    assert shell(tmp_path, STATE, CELERY_BROKER_URL=redis.url) == f"{FULL}\n"


@pytest.fixture
def settings_of_rabbitmq(tmp_path: Path) -> Path:
    """The configuration of RabbitMQ that the server reads, with the lines that the page names."""
    path = tmp_path / "rabbitmq.conf"
    path.write_text((ROOT / "deploy" / "rabbitmq.conf").read_text())
    return path


def test_a_full_rabbitmq_is_named(tmp_path: Path, settings_of_rabbitmq: Path, rabbitmq: RabbitMQ) -> None:
    assert shell(tmp_path, STATE, CELERY_BROKER_URL=rabbitmq.url) == "ok\n"
    rabbitmq.kill()
    settings_of_rabbitmq.write_text(settings_of_rabbitmq.read_text() + MEMORY_LIMIT)
    rabbitmq.start()

    assert shell(tmp_path, STATE, CELERY_BROKER_URL=rabbitmq.url) == f"{FULL}\n"
