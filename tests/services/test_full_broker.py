"""A broker that answers, but takes no messages, is named: clients and workers see no error of their own."""

import pytest
import redis as redis_client
from celery import Celery

from crowd.operations import broker
from tests.services.rabbitmq import RabbitMQ
from tests.services.redis import Redis
from tests.waiting import until


def test_a_full_redis_is_named(redis: Redis, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broker, "app", Celery(broker=redis.url, set_as_current=False))
    assert broker.state() == "ok"

    redis_client.Redis.from_url(redis.url).config_set("maxmemory", "1")

    assert broker.state() == broker.FULL


def test_a_rabbitmq_with_an_alarm_is_named(rabbitmq: RabbitMQ, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broker, "app", Celery(broker=rabbitmq.url, set_as_current=False))
    assert broker.state() == "ok"

    for setting, too_much, enough in (
        ("set_vm_memory_high_watermark", "0.00001", "0.9"),
        ("set_disk_free_limit", "1000000GB", "1MB"),
    ):
        rabbitmq.control(setting, too_much)
        until(lambda: broker.state() == broker.FULL)
        rabbitmq.control(setting, enough)
        until(lambda: broker.state() == "ok")
