"""Daily limits of an installation: bytes sent, values sent, growth of the database; of an address: growth.

Bytes and values are counted before decoding, even if the request is refused afterwards. They count only for
the installation: otherwise one participant could block all others behind the same address. Growth is counted
before anything is stored.
"""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from django.conf import settings
from django.db.models import Model

from crowd.access import counters
from crowd.access.counters import Count
from crowd.devices.models import Installation
from crowd.http.problems import Problem
from crowd.results.models import MeasurementSession, Run, RunFrames, Submission

# The growth that an address may cause, as a multiple of an installation's. Once it is used up, each of its
# installations still has an equal part of it.
ADDRESS_FACTOR = 4
# What a row adds to the database besides its columns: index entries, and rows derived from it, such as a
# run's summary or a description's device model.
ROW_BYTES = {Submission: 5_000, MeasurementSession: 1_500, Run: 1_000, RunFrames: 50}
COLUMN_BYTES = 8
PAGE_BYTES = 4096  # of SQLite


@dataclass(frozen=True)
class Sender:
    """The sender of a request.

    `address`: as the server sees it, never stored; empty: not counted. `network`: keyed hash, empty: unknown.
    """

    installation: Installation
    address: str = ""
    network: str = ""


@dataclass(frozen=True)
class DailyLimit:
    """A daily limit. `setting` names the setting with the quota of an installation (0: no limit)."""

    name: str
    setting: str
    unit: str

    @property
    def quota(self) -> int:
        """The amount that one installation may send in a day."""
        return int(getattr(settings, self.setting))


BYTES = DailyLimit("bytes", "FRONTRUNNER_BYTES_PER_DAY", "bytes after gzip")
VALUES = DailyLimit("values", "FRONTRUNNER_VALUES_PER_DAY", "values")
STORED = DailyLimit("stored", "FRONTRUNNER_STORED_BYTES_PER_DAY", "bytes in the database")


def active_limits() -> list[DailyLimit]:
    """The daily limits that are switched on."""
    return [limit for limit in (BYTES, VALUES, STORED) if limit.quota]


def count_body(sender: Sender, body: bytes) -> None:
    """Count `body` before it is decoded. Raises Problem 429 above a limit."""
    _count(sender, BYTES, len(body))
    # Each value except the last of its list or object is followed by a comma.
    _count(sender, VALUES, body.count(b",") + 1)


def count_rows(sender: Sender, rows: Iterable[Model], description: dict[str, Any]) -> None:
    """Count how much `rows`, from a device with `description`, will grow the database. Raises Problem 429."""
    if not STORED.quota:
        return
    amount = database_growth(rows) + len(json.dumps(description))
    own = _count(sender, STORED, amount)
    if own is None or not sender.address:
        return
    with counters.tolerate_failure("amounts"):
        _count_address(sender.address, amount, own)


def _count_address(address_of_sender: str, amount: int, own: Count) -> None:
    """Count `amount` for an address, of which `own` is the installation's. Raises Problem 429."""
    address, quota = counters.hmac_identifier(address_of_sender), ADDRESS_FACTOR * STORED.quota
    all_of_it = counters.count(f"daily-{STORED.name}:address:{address}", counters.A_DAY, amount)
    is_first = own.used == amount
    sharing = counters.count(f"daily-sharing:{address}", counters.A_DAY, int(is_first))
    if all_of_it.used > quota and own.used > quota / max(sharing.used, 1):
        raise _exceeded(all_of_it, f"{quota} {STORED.unit} of an address that {sharing.used} devices share")


def database_growth(rows: Iterable[Model]) -> int:
    """An upper bound of the bytes that `rows` add to the database, with indexes and derived rows."""
    return sum(
        ROW_BYTES[type(row)]
        + _bytes_on_pages(
            sum(_column_bytes(getattr(row, field.attname)) for field in row._meta.concrete_fields)
        )
        for row in rows
    )


def _bytes_on_pages(content: int) -> int:
    """The bytes that a row of `content` bytes takes. Above half a page, the rest of the page stays empty."""
    if content > PAGE_BYTES:
        return content + PAGE_BYTES // 2
    return PAGE_BYTES if content > PAGE_BYTES // 2 else content


def _column_bytes(value: Any) -> int:
    match value:
        case bytes():
            return len(value)
        case str():
            return len(value.encode())
        case dict() | list():
            return len(json.dumps(value))
    return COLUMN_BYTES


def _count(sender: Sender, limit: DailyLimit, amount: int) -> Count | None:
    """Count `amount` for the installation; None if it is not counted. Raises Problem 429 above its quota."""
    if not limit.quota:
        return None
    with counters.tolerate_failure("amounts"):
        count = counters.count(
            f"daily-{limit.name}:installation:{sender.installation.pk}", counters.A_DAY, amount
        )
        if count.used > limit.quota:
            raise _exceeded(count, f"{limit.quota} {limit.unit}")
        return count
    return None


def _exceeded(count: Count, allowance: str) -> Problem:
    wait = max(math.ceil(count.resets_in), 1)
    text = f"at most {allowance} a day: keep the results and send them in {wait} s"
    return Problem("daily_limit", text, retry_after=wait)
