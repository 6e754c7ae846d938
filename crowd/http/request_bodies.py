"""Reads the body of a request on the event loop, so that a slow sender does not occupy a thread.

Each body has a deadline and a size limit. All bodies of this process share one memory limit.
"""

import asyncio
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from crowd.http.problems import Problem

Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]

# The first bytes of each body do not count against the shared limit, so that a few large bodies cannot block
# ordinary submissions. The number of connections limits these bytes.
UNCOUNTED_BYTES = 1 << 16
# A refused body is still read up to this multiple of its limit. A client that is still sending when the
# connection closes often loses the response.
DISCARD_FACTOR = 4
RETRY_SECONDS = 5


class MemoryPool:
    """The memory for all bodies of one process, in bytes. Only one event loop uses it."""

    def __init__(self, size: int) -> None:
        self.free = size


class MemoryShare:
    """The part of a `pool` that one body holds."""

    def __init__(self, pool: MemoryPool) -> None:
        self._pool = pool
        self._taken = 0

    def grow(self, size: int) -> bool:
        """Grow to what a body of `size` bytes needs.

        Returns False, and takes nothing, if the pool is empty.
        """
        more = max(size - UNCOUNTED_BYTES, 0) - self._taken
        if more > self._pool.free:
            return False
        self._pool.free -= more
        self._taken += more
        return True

    def release(self) -> None:
        """Return everything to the pool."""
        self._pool.free += self._taken
        self._taken = 0


async def read_body(
    receive: Receive, share: MemoryShare, limit: int, seconds: float, length: int | None = None
) -> bytes:
    """Read a body from `receive`: at most `limit` bytes within `seconds`. `length` is its size, if known.

    Raises Problem: 408 body_too_slow, 413 body_too_large, 503 server_busy if `share` cannot grow, 400
    body_incomplete if the client disconnects.
    """
    try:
        async with asyncio.timeout(seconds):
            return await _read(receive, share, limit, length)
    except TimeoutError:
        raise Problem("body_too_slow", f"the body did not arrive within {seconds:g} s") from None


async def _read(receive: Receive, share: MemoryShare, limit: int, length: int | None) -> bytes:
    content = bytearray()
    size, refusal, more = 0, None, True
    while more and size <= DISCARD_FACTOR * limit:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise Problem("body_incomplete", "the connection ended before the body did")
        chunk = message.get("body", b"")
        size += len(chunk)
        # With a known length, do not wait for the message that only reports the end.
        more = message.get("more_body", False) and size != length
        refusal = refusal or _refusal(size, limit, share)
        if refusal:
            content.clear()
            share.release()
        else:
            content += chunk
    if refusal:
        raise refusal
    return bytes(content)


def _refusal(size: int, limit: int, share: MemoryShare) -> Problem | None:
    if size > limit:
        return Problem("body_too_large", f"at most {limit} bytes a request: send fewer runs at once")
    if not share.grow(size):
        detail = f"the server is reading many large bodies: wait {RETRY_SECONDS} s"
        return Problem("server_busy", detail, retry_after=RETRY_SECONDS)
    return None
