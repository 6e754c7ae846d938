"""Reads the body of a request on the event loop, where a slow sender costs no thread.

A body has a deadline and a size limit. All bodies that this process holds share a limit, too.
"""

import asyncio
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from crowd.http.problems import Problem

Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]

# The first bytes of each body do not count against the shared limit: a few large bodies cannot keep ordinary
# submissions out. The number of connections limits them.
UNCOUNTED_BYTES = 1 << 16
# What is read of a body that was refused already, in multiples of its limit. A client that still sends when
# the connection closes often loses the answer.
DISCARDED = 4
RETRY_SECONDS = 5


class Pool:
    """The bytes that all bodies of one process may hold together. Used by one event loop alone."""

    def __init__(self, size: int) -> None:
        self.free = size


class Share:
    """What one body holds of a POOL."""

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._taken = 0

    def grow(self, size: int) -> bool:
        """Take as much as a body of SIZE bytes needs; False, and nothing taken, where the pool is empty."""
        more = max(size - UNCOUNTED_BYTES, 0) - self._taken
        if more > self._pool.free:
            return False
        self._pool.free -= more
        self._taken += more
        return True

    def release(self) -> None:
        """Give everything back."""
        self._pool.free += self._taken
        self._taken = 0


async def read(
    receive: Receive, share: Share, limit: int, seconds: float, length: int | None = None
) -> bytes:
    """The body that RECEIVE delivers, at most LIMIT bytes within SECONDS; its LENGTH, where that is known.

    Raises Problem: 408 body_too_slow, 413 body_too_large, 503 server_busy where the SHARE cannot grow, 400
    body_incomplete where the client hangs up.
    """
    try:
        async with asyncio.timeout(seconds):
            return await _read(receive, share, limit, length)
    except TimeoutError:
        raise Problem(408, "body_too_slow", f"the body did not arrive within {seconds:g} s") from None


async def _read(receive: Receive, share: Share, limit: int, length: int | None) -> bytes:
    content = bytearray()
    size, refusal, more = 0, None, True
    while more and size <= DISCARDED * limit:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Problem(400, "body_incomplete", "the connection ended before the body did")
        piece = message.get("body", b"")
        size += len(piece)
        # With a known length, the message that only reports the end is not waited for.
        more = message.get("more_body", False) and size != length
        refusal = refusal or _refusal(size, limit, share)
        if refusal:
            content.clear()
            share.release()
        else:
            content += piece
    if refusal:
        raise refusal
    return bytes(content)


def _refusal(size: int, limit: int, share: Share) -> Problem | None:
    if size > limit:
        return Problem(413, "body_too_large", f"at most {limit} bytes a request: send fewer runs at once")
    if not share.grow(size):
        detail = f"the server reads many large bodies now: wait {RETRY_SECONDS} s"
        return Problem(503, "server_busy", detail, retry_after=RETRY_SECONDS)
    return None
