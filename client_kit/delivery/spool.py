"""Measured sessions on disk, from the measurement until the server's answer."""

import gzip
import json
import random
import sqlite3
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from client_kit.errors import HomeError

QUEUED, SENDING, ACCEPTED, DUPLICATE = "queued", "sending", "accepted", "duplicate"
REJECTED, EXPIRED = "rejected", "expired"
DRAFT = "draft"
WAITING = (QUEUED, SENDING)

FIRST_PAUSE_SECONDS = 30.0
LONGEST_PAUSE_SECONDS = 6 * 3600.0
LARGEST_BYTES = 10 * 2**20
MOST_ITEMS = 500

_SCHEMA = """
CREATE TABLE IF NOT EXISTS session (
    id TEXT PRIMARY KEY,
    server TEXT NOT NULL,
    idempotency_key TEXT NOT NULL UNIQUE,
    body BLOB,
    bytes INTEGER NOT NULL,
    state TEXT NOT NULL
        CHECK (state IN ('draft', 'queued', 'sending', 'accepted', 'duplicate', 'rejected', 'expired')),
    attempts INTEGER NOT NULL DEFAULT 0,
    created REAL NOT NULL,
    not_before REAL NOT NULL DEFAULT 0,
    asked_to_wait INTEGER NOT NULL DEFAULT 0,
    reason TEXT,
    submission_id TEXT
)
"""
_COLUMNS = (
    "id, server, idempotency_key, bytes, state, attempts, created, not_before, asked_to_wait, reason, "
    "submission_id"
)
_STORE = """
INSERT INTO session (id, server, idempotency_key, body, bytes, state, created) VALUES (?, ?, ?, ?, ?, ?, ?)
ON CONFLICT (id) DO UPDATE SET body = excluded.body, bytes = excluded.bytes, state = excluded.state
WHERE session.state = 'draft'
"""


@dataclass(frozen=True)
class Item:
    """One session of the spool. `not_before` and `created` are seconds since the epoch; `asked_to_wait`: the
    server, not this client, chose `not_before`."""

    id: str
    server: str
    idempotency_key: str
    bytes: int
    state: str
    attempts: int
    created: float
    not_before: float
    asked_to_wait: bool
    reason: str | None
    submission_id: str | None

    def due(self, now: float, *, eager: bool = False) -> bool:
        """Whether it may be sent now; `eager` ignores this client's own pauses, not the server's.

        A time beyond any pause comes from a clock that was set back, and counts as due.
        """
        if self.state not in WAITING:
            return False
        if eager and not self.asked_to_wait:
            return True
        longest = 24 * 3600.0 if self.asked_to_wait else LONGEST_PAUSE_SECONDS
        return not now < self.not_before <= now + longest


class Spool:
    """The queue of sessions, one row each, in a SQLite file that is synced with every change.

    Several processes may use one file. Methods raise HomeError when the disk is full or the file damaged.
    """

    def __init__(
        self,
        path: Path,
        clock: Callable[[], float] = time.time,
        jitter: Callable[[], float] = random.random,
    ) -> None:
        self._path = path
        self._clock = clock
        self._jitter = jitter
        with self._transaction() as connection:
            connection.execute(_SCHEMA)

    def keep_draft(
        self, server: str, payload: Mapping[str, Any], allowed: Callable[[], None] = lambda: None
    ) -> None:
        """Store the finished runs of a session in progress as a draft, replacing the last one, and sync.
        Drafts are not sent: `put` or `queue_drafts` turns them into sessions. `allowed` is as in `put`.
        """
        self._store(server, payload, DRAFT, allowed)

    def drafts(self) -> list[Item]:
        """The sessions in progress, and those of clients that were killed."""
        return self._items("state = 'draft'")

    def queue_drafts(self) -> None:
        """Queue the sessions of killed clients. Call it only while no other client measures."""
        with self._transaction() as connection:
            connection.execute("UPDATE session SET state = 'queued' WHERE state = 'draft'")

    def put(
        self, server: str, payload: Mapping[str, Any], allowed: Callable[[], None] = lambda: None
    ) -> Item:
        """Store a submission of one session for `server`, and sync. Its draft, if any, becomes this session;
        the idempotency key stays.

        The body is packed once, here: later attempts send the same bytes under the same key. `allowed` is
        called while the spool is locked; an error of it cancels the call.
        """
        return self.item(self._store(server, payload, QUEUED, allowed))

    def _store(self, server: str, payload: Mapping[str, Any], state: str, allowed: Callable[[], None]) -> str:
        session_id = str(payload["sessions"][0]["id"])
        body = _packed(payload)
        with self._transaction() as connection:
            allowed()
            row = (session_id, server, str(uuid.uuid4()), body, len(body), state, self._clock())
            if not connection.execute(_STORE, row).rowcount:
                raise HomeError(f"the session {session_id} is in the spool already")
            _keep_quota(connection, session_id)
        return session_id

    def item(self, session_id: str) -> Item:
        """The session of that id. Raises KeyError."""
        item = self.find(session_id)
        if item is None:
            raise KeyError(session_id)
        return item

    def find(self, session_id: str) -> Item | None:
        """The session of that id, draft or not; None where it was erased."""
        with self._transaction() as connection:
            row = connection.execute(f"SELECT {_COLUMNS} FROM session WHERE id = ?", (session_id,)).fetchone()
        return None if row is None else _item(row)

    def items(self) -> list[Item]:
        """All finished sessions, oldest first."""
        return self._items("state != 'draft'")

    def _items(self, which: str) -> list[Item]:
        with self._transaction() as connection:
            # Not by `created`: clocks are set back.
            rows = connection.execute(f"SELECT {_COLUMNS} FROM session WHERE {which} ORDER BY rowid")
            return [_item(row) for row in rows]

    def body(self, item: Item) -> bytes | None:
        """The body of a session: gzipped JSON; None if dropped for the quota."""
        with self._transaction() as connection:
            row = connection.execute("SELECT body FROM session WHERE id = ?", (item.id,)).fetchone()
        return row[0] if row else None

    def payload(self, item: Item) -> dict[str, Any] | None:
        """The payload of a session; None if dropped for the quota."""
        body = self.body(item)
        return None if body is None else json.loads(gzip.decompress(body))

    def renew(self, item: Item, payload: Mapping[str, Any]) -> None:
        """Replace the payload of a waiting session by `payload`, under a new key since its bytes differ."""
        body = _packed(payload)
        with self._transaction() as connection:
            connection.execute(
                "UPDATE session SET body = ?, bytes = ?, idempotency_key = ?, not_before = 0, reason = NULL "
                "WHERE id = ? AND body IS NOT NULL",
                (body, len(body), str(uuid.uuid4()), item.id),
            )

    def holding(self, run: str) -> Item | None:
        """The session with the run of that id, if its body is still here, else None."""
        for item in self.items():
            payload = self.payload(item)
            if payload is not None and any(one["id"] == run for one in payload["sessions"][0]["runs"]):
                return item
        return None

    def drop(self, item: Item, run: str) -> None:
        """Forget one run of a session, and the session with its last one.

        A waiting session is sent without it, under a new key. Call it only while no other process sends.
        """
        payload = self.payload(item)
        if payload is None:
            return
        [session] = payload["sessions"]
        runs = [one for one in session["runs"] if one["id"] != run]
        if runs:
            self.renew(item, {**payload, "sessions": [{**session, "runs": runs}]})
            return
        with self._transaction() as connection:
            connection.execute("DELETE FROM session WHERE id = ?", (item.id,))

    def recover(self) -> None:
        """Queue again the sessions of a process that died while sending.

        Call it only while no other one sends.
        """
        with self._transaction() as connection:
            connection.execute("UPDATE session SET state = 'queued' WHERE state = 'sending'")

    def mark_sending(self, item: Item) -> None:
        """Mark a session as sending, before the first byte leaves."""
        with self._transaction() as connection:
            connection.execute(
                "UPDATE session SET state = 'sending', attempts = attempts + 1 WHERE id = ?", (item.id,)
            )

    def settle(self, item: Item, state: str, reason: str | None, submission_id: str | None = None) -> None:
        """Record the server's final answer: ACCEPTED, DUPLICATE or REJECTED, with its reason."""
        with self._transaction() as connection:
            connection.execute(
                "UPDATE session SET state = ?, reason = ?, submission_id = ?, not_before = 0 WHERE id = ?",
                (state, reason, submission_id, item.id),
            )

    def postpone(self, item: Item, reason: str, retry_after: float | None = None) -> None:
        """Queue a session again: after `retry_after` seconds if the server gave them, else after a random
        pause whose bound doubles with every attempt (full jitter). A session that was erased meanwhile stays
        erased."""
        with self._transaction() as connection:
            row = connection.execute("SELECT attempts FROM session WHERE id = ?", (item.id,)).fetchone()
            if row is None:
                return
            bound = min(LONGEST_PAUSE_SECONDS, FIRST_PAUSE_SECONDS * 2 ** min(max(row[0] - 1, 0), 20))
            pause = self._jitter() * bound if retry_after is None else retry_after
            connection.execute(
                "UPDATE session SET state = 'queued', reason = ?, not_before = ?, asked_to_wait = ? "
                "WHERE id = ?",
                (reason, self._clock() + pause, retry_after is not None, item.id),
            )

    def clear(self) -> int:
        """Delete every session, sent or not, and every draft; return their number."""
        with self._transaction() as connection:
            return connection.execute("DELETE FROM session").rowcount

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        try:
            connection = sqlite3.connect(self._path, timeout=20, isolation_level=None)
            try:
                connection.execute("PRAGMA synchronous = FULL")
                connection.execute("BEGIN IMMEDIATE")
                yield connection
                connection.execute("COMMIT")
            finally:
                connection.close()
        except sqlite3.Error as error:
            raise HomeError(f"the spool {self._path} cannot be used: {error}") from error


def _packed(payload: Mapping[str, Any]) -> bytes:
    text = json.dumps(payload, separators=(",", ":"), allow_nan=False)
    return gzip.compress(text.encode(), mtime=0)


def _item(row: tuple[Any, ...]) -> Item:
    values = list(row)
    values[8] = bool(values[8])
    return Item(*values)


def _keep_quota(connection: sqlite3.Connection, newest: str) -> None:
    """Stay below the quota: answered sessions are dropped first, then the oldest unsent ones expire; never
    the newest or a draft. Only the body is dropped; the row stays as a record."""
    rows = connection.execute(
        "SELECT id, bytes, state IN ('queued', 'sending') AS unsent FROM session "
        "WHERE body IS NOT NULL AND id != ? AND state != 'draft' ORDER BY unsent, rowid",
        (newest,),
    ).fetchall()
    size, items = connection.execute(
        "SELECT coalesce(sum(bytes), 0), count(*) FROM session WHERE body IS NOT NULL"
    ).fetchone()
    excess_bytes = size - LARGEST_BYTES
    excess_items = items - MOST_ITEMS
    for session_id, nbytes, unsent in rows:
        if excess_bytes <= 0 and excess_items <= 0:
            return
        excess_bytes -= nbytes
        excess_items -= 1
        if unsent:
            connection.execute(
                "UPDATE session SET body = NULL, state = 'expired', reason = ? WHERE id = ?",
                (f"the spool holds at most {MOST_ITEMS} sessions and {LARGEST_BYTES >> 20} MiB", session_id),
            )
        else:
            connection.execute("UPDATE session SET body = NULL WHERE id = ?", (session_id,))
