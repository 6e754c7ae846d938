"""A Redis that answers, but takes no messages, is named: clients and workers see no error of their own."""

from pathlib import Path

import redis as redis_client

from crowd.operations.broker import FULL
from tests.services.redis import Redis
from tests.services.serving import shell

STATE = "from crowd.operations import broker; print(broker.state())"


def test_a_full_redis_is_named(tmp_path: Path, redis: Redis) -> None:
    assert shell(tmp_path, STATE, CELERY_BROKER_URL=redis.url) == "ok\n"

    redis_client.Redis.from_url(redis.url).config_set("maxmemory", "1")

    assert shell(tmp_path, STATE, CELERY_BROKER_URL=redis.url) == f"{FULL}\n"
