"""Bodies are read with a deadline, a limit each and a limit together."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from crowd.http.problems import Problem
from crowd.http.request_bodies import DISCARD_FACTOR, UNCOUNTED_BYTES, MemoryPool, MemoryShare, read_body

LIMIT = 1000
Receive = Callable[[], Awaitable[dict[str, Any]]]


def sent(*pieces: bytes, ended: bool = True, hung_up: bool = False) -> Receive:
    """What a client sends piece by piece; without an end it goes on for ever, in silence."""
    messages: list[dict[str, Any]] = [
        {"type": "http.request", "body": piece, "more_body": True} for piece in pieces
    ]
    if hung_up:
        messages.append({"type": "http.disconnect"})
    elif ended:
        messages.append({"type": "http.request", "body": b"", "more_body": False})

    async def receive() -> dict[str, Any]:
        if not messages:
            await asyncio.Event().wait()
        return messages.pop(0)

    receive.left = messages  # type: ignore[attr-defined]
    return receive


def content(receive: Receive, share: MemoryShare, seconds: float = 60.0) -> bytes:
    return asyncio.run(read_body(receive, share, LIMIT, seconds))


def refusal(receive: Receive, share: MemoryShare, seconds: float = 60.0) -> tuple[int, str]:
    with pytest.raises(Problem) as raised:
        content(receive, share, seconds)
    return raised.value.status, raised.value.code


@pytest.fixture
def pool() -> MemoryPool:
    return MemoryPool(1 << 20)


def test_a_body_ends_with_its_last_piece_or_its_last_byte(pool: MemoryPool) -> None:
    silent = sent(b"hello", ended=False)

    assert content(sent(b"a" * 500, b"b" * 500), MemoryShare(pool)) == b"a" * 500 + b"b" * 500
    assert asyncio.run(read_body(silent, MemoryShare(pool), LIMIT, 60.0, length=5)) == b"hello"


def test_one_byte_too_many_is_refused_when_the_client_has_sent_all(pool: MemoryPool) -> None:
    receive = sent(b"a" * LIMIT, b"b", b"c" * LIMIT)

    assert refusal(receive, MemoryShare(pool)) == (413, "body_too_large")
    assert receive.left == []  # type: ignore[attr-defined]


def test_an_endless_body_is_not_read_to_its_end(pool: MemoryPool) -> None:
    receive = sent(*[b"a" * LIMIT] * 100, ended=False)

    assert refusal(receive, MemoryShare(pool)) == (413, "body_too_large")
    assert len(receive.left) == 100 - DISCARD_FACTOR - 1  # type: ignore[attr-defined]


def test_a_body_that_stops_or_breaks_off_is_refused(pool: MemoryPool) -> None:
    assert refusal(sent(b"a", ended=False), MemoryShare(pool), seconds=0.01) == (408, "body_too_slow")
    assert refusal(sent(b"a", hung_up=True), MemoryShare(pool)) == (400, "body_incomplete")


def test_large_bodies_share_one_limit_and_small_ones_always_pass() -> None:
    pool = MemoryPool(UNCOUNTED_BYTES)
    first, second, third = (MemoryShare(pool) for _ in range(3))

    assert first.grow(2 * UNCOUNTED_BYTES)
    assert not second.grow(UNCOUNTED_BYTES + 1)
    assert third.grow(UNCOUNTED_BYTES)
    first.release()
    assert second.grow(UNCOUNTED_BYTES + 1)


def test_a_body_that_finds_no_room_is_asked_to_come_again() -> None:
    full = MemoryPool(0)
    large = [b"a" * UNCOUNTED_BYTES, b"b"]

    with pytest.raises(Problem) as raised:
        asyncio.run(read_body(sent(*large), MemoryShare(full), 2 * UNCOUNTED_BYTES, 60.0))
    assert (raised.value.status, raised.value.code) == (503, "server_busy")
    assert raised.value.retry_after


def test_a_refused_body_holds_nothing(pool: MemoryPool) -> None:
    share = MemoryShare(pool)
    limit = 2 * UNCOUNTED_BYTES

    with pytest.raises(Problem):
        asyncio.run(read_body(sent(b"a" * limit, b"b"), share, limit, 60.0))
    assert pool.free == 1 << 20
