"""Whether the broker answers, and whether Redis still takes messages."""

from typing import Any

import redis
from kombu.exceptions import KombuError, OperationalError

from crowd.celery import app

TIMEOUT_SECONDS = 2
# No check waits longer for an answer, the closing of its connection included.
SOCKET_TIMEOUTS = {"read_timeout": TIMEOUT_SECONDS, "write_timeout": TIMEOUT_SECONDS}
# A key of Redis that lives a second.
PROBE = "frontrunner-probe"
FULL = "is full: raise its limit of memory or disk, or remove what fills it"


def state() -> str:
    """ "ok", or why the broker takes no messages."""
    broker = app.connection_for_write(connect_timeout=TIMEOUT_SECONDS, transport_options=SOCKET_TIMEOUTS)
    try:
        broker.ensure_connection(max_retries=1, timeout=TIMEOUT_SECONDS)
        return "ok" if _takes_messages(broker) else FULL
    except (KombuError, OperationalError, OSError) as error:
        return f"does not answer: {type(error).__name__}"
    finally:
        broker.release()


def waiting(queue: str) -> int | None:
    """How many messages wait in `queue`; None if the broker does not answer."""
    broker = app.connection_for_write(connect_timeout=TIMEOUT_SECONDS, transport_options=SOCKET_TIMEOUTS)
    try:
        broker.ensure_connection(max_retries=1, timeout=TIMEOUT_SECONDS)
        return int(broker.default_channel.queue_declare(queue, passive=True).message_count)
    except broker.channel_errors:
        return 0  # no message was sent yet
    except (KombuError, OperationalError, OSError):
        return None
    finally:
        broker.release()


def _takes_messages(broker: Any) -> bool:
    if broker.transport.driver_type == "redis":
        try:
            broker.default_channel.client.set(PROBE, "", px=1000)
        except redis.OutOfMemoryError:
            return False
    return True
