"""Whether the broker answers, and whether Redis or RabbitMQ still takes messages."""

from typing import Any

import redis
from kombu.exceptions import KombuError, OperationalError

from crowd.celery import app

TIMEOUT_SECONDS = 2
# No check waits longer for an answer, the closing of its connection included. RabbitMQ confirms messages.
OPTIONS = {"read_timeout": TIMEOUT_SECONDS, "write_timeout": TIMEOUT_SECONDS, "confirm_publish": True}
# A key of Redis that lives a second; a message to RabbitMQ that no queue takes.
PROBE = "frontrunner-probe"
FULL = "is full: raise its limit of memory or disk, or remove what fills it"


def state() -> str:
    """ "ok", or why the broker takes no messages."""
    broker = app.connection_for_write(connect_timeout=TIMEOUT_SECONDS, transport_options=OPTIONS)
    try:
        broker.ensure_connection(max_retries=1, timeout=TIMEOUT_SECONDS)
        return "ok" if _takes_messages(broker) else FULL
    except (KombuError, OperationalError, OSError) as error:
        return f"does not answer: {type(error).__name__}"
    finally:
        broker.release()


def waiting(queue: str) -> int | None:
    """How many messages wait in `queue`; None if the broker does not answer."""
    broker = app.connection_for_write(connect_timeout=TIMEOUT_SECONDS, transport_options=OPTIONS)
    try:
        broker.ensure_connection(max_retries=1, timeout=TIMEOUT_SECONDS)
        return int(broker.default_channel.queue_declare(queue, passive=True).message_count)
    except broker.channel_errors:
        return 0  # no message was sent yet
    except (KombuError, OperationalError, OSError):
        return None
    finally:
        broker.release()


class _AlarmError(Exception):
    """RabbitMQ has an alarm about its memory or disk."""


def _takes_messages(broker: Any) -> bool:
    try:
        if broker.transport.driver_type == "redis":
            broker.default_channel.client.set(PROBE, "", px=1000)
        elif broker.transport.driver_type == "amqp":
            broker.connection.on_blocked = _raise_alarm
            broker.Producer().publish("", routing_key=PROBE, timeout=TIMEOUT_SECONDS)
    except redis.OutOfMemoryError:
        return False
    except _AlarmError:
        broker.connection.collect()  # without a farewell, which RabbitMQ would not read
        return False
    return True


def _raise_alarm(reason: str) -> None:
    raise _AlarmError(reason)
