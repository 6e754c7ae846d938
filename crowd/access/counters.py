"""Counters in time windows, shared by all processes.

They are kept in a small SQLite file beside the database, or in the Redis that FRONTRUNNER_CACHE_URL names.
They are not in the database for three reasons: a read must not wait for a writer, a request must not cost a
transaction, and no trace of an address may get into a backup.
"""

import contextlib
import hashlib
import hmac
import logging
import secrets
import sqlite3
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import redis
from django.conf import settings

TIMEOUT_SECONDS = 0.5
# NORMAL with a write-ahead log: no wait for the disk, and consistent after a power cut.
PREPARATION = """
PRAGMA journal_mode = WAL;
PRAGMA synchronous = NORMAL;
CREATE TABLE IF NOT EXISTS counts (key TEXT PRIMARY KEY, used INTEGER, resets REAL) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS counts_resets ON counts (resets);
CREATE TABLE IF NOT EXISTS salts (day TEXT PRIMARY KEY, salt BLOB) WITHOUT ROWID;
"""
# A process may read the clock so long (seconds) before its turn in the file.
WAITED = 2 * TIMEOUT_SECONDS
A_DAY = 24 * 3600
PREFIX = "frontrunner:"


log = logging.getLogger(__name__)


class CountingError(Exception):
    """The store does not answer. Callers continue without it (`tolerate_failure`)."""


@dataclass(frozen=True)
class Count:
    """The count of a key in its current window, and the seconds until the window ends."""

    used: int
    resets_in: float


class Store(ABC):
    """Where counts are kept. Both methods raise CountingError."""

    @abstractmethod
    def count(self, key: str, seconds: int, amount: int = 1) -> Count:
        """Add `amount` (0 or more) to `key` and return its count.

        A window starts with the first count after the previous window ended.
        """

    @abstractmethod
    def salt(self, day: str) -> bytes:
        """The random salt of `day`: the same in every process, deleted a day or two later."""


class FileStore(Store):
    """Counts in a SQLite file: one statement per count, no wait for the disk."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._local = threading.local()

    def count(self, key: str, seconds: int, amount: int = 1) -> Count:
        now = time.time()
        with self._connected() as connection:
            used, resets = connection.execute(
                # A window that ends later than any can began before the clock was set back: it begins again.
                "INSERT INTO counts (key, used, resets) VALUES (:key, :amount, :now + :seconds) ON CONFLICT "
                "(key) DO UPDATE SET "
                "used = CASE WHEN resets > :now AND resets <= :latest THEN used ELSE 0 END + :amount, "
                "resets = CASE WHEN resets > :now AND resets <= :latest THEN resets ELSE :now + :seconds END "
                "RETURNING used, resets",
                {
                    "key": key,
                    "now": now,
                    "seconds": seconds,
                    "amount": amount,
                    "latest": now + seconds + WAITED,
                },
            ).fetchone()
            if used == amount:  # a new window
                connection.execute("DELETE FROM counts WHERE resets <= ?", (now,))
        return Count(used, min(max(resets - now, 0.0), seconds))

    def salt(self, day: str) -> bytes:
        with self._connected() as connection:
            connection.execute("DELETE FROM salts WHERE day < ?", (day,))
            connection.execute(
                "INSERT INTO salts (day, salt) VALUES (?, ?) ON CONFLICT DO NOTHING",
                (day, secrets.token_bytes(32)),
            )
            (salt,) = connection.execute("SELECT salt FROM salts WHERE day = ?", (day,)).fetchone()
        return bytes(salt)

    @contextlib.contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        """This thread's connection."""
        try:
            connection: sqlite3.Connection | None = getattr(self._local, "connection", None)
            if connection is None:
                connection = self._local.connection = self._connect()
            yield connection
        except sqlite3.Error as error:
            raise CountingError(f"{self.path}: {error}") from error

    def _connect(self) -> sqlite3.Connection:
        connection = sqlite3.connect(self.path, timeout=TIMEOUT_SECONDS, isolation_level=None)
        deadline = time.monotonic() + TIMEOUT_SECONDS
        while True:
            try:
                connection.executescript(PREPARATION)
                return connection
            except sqlite3.OperationalError:
                # SQLite's timeout does not cover the moment when another connection switches to the
                # write-ahead log.
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.005)


class RedisStore(Store):
    """Counts in a Redis that several machines share: one round trip per count."""

    def __init__(self, url: str) -> None:
        self._redis = redis.Redis.from_url(
            url, socket_timeout=TIMEOUT_SECONDS, socket_connect_timeout=TIMEOUT_SECONDS
        )

    def count(self, key: str, seconds: int, amount: int = 1) -> Count:
        name = f"{PREFIX}{key}"
        try:
            with self._redis.pipeline(transaction=True) as steps:
                steps.set(name, 0, ex=seconds, nx=True)
                steps.incrby(name, amount)
                steps.pttl(name)
                _, used, left = steps.execute()
        except redis.RedisError as error:
            raise CountingError(f"Redis: {error}") from error
        return Count(used, max(left, 0) / 1000)

    def salt(self, day: str) -> bytes:
        name = f"{PREFIX}salt:{day}"
        try:
            with self._redis.pipeline(transaction=True) as steps:
                steps.set(name, secrets.token_hex(32), ex=2 * A_DAY, nx=True)
                steps.get(name)
                _, salt = steps.execute()
        except redis.RedisError as error:
            raise CountingError(f"Redis: {error}") from error
        return bytes(salt)


def count(key: str, seconds: int, amount: int = 1) -> Count:
    """Add `amount` to `key` in its window of `seconds`. Raises CountingError."""
    return _store().count(key, seconds, amount)


@contextlib.contextmanager
def tolerate_failure(what: str) -> Iterator[None]:
    """Leave the block when the store fails, and log that `what` is not counted.

    A full disk or a missing Redis must neither stop the server nor lock administrators out.
    """
    try:
        yield
    except CountingError as error:
        log.warning("%s are not counted now: %s", what, error)


def hmac_identifier(address: str) -> str:
    """A keyed hash of `address` that changes every day; the random key is deleted a day or two later.

    Raises CountingError.
    """
    salt = _salt(_store(), datetime.now(UTC).date().isoformat())
    return hmac.new(salt, address.encode(), hashlib.sha256).hexdigest()[:32]


def _store() -> Store:
    return _open_store(settings.FRONTRUNNER_CACHE_URL, Path(settings.FRONTRUNNER_VAR) / "counters.sqlite3")


@lru_cache(maxsize=1)
def _open_store(url: str, path: Path) -> Store:
    return RedisStore(url) if url else FileStore(path)


@lru_cache(maxsize=2)
def _salt(store: Store, day: str) -> bytes:
    return store.salt(day)
