"""Daily limits of an installation and of an address: bytes sent, values sent, growth of the database.

Bytes and values are counted before decoding, even if the request is refused afterwards. Growth is counted
before anything is stored. Simulated installations have no limit: an administrator permits each.
"""

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from django.conf import settings
from django.db.models import Model

from crowd.access import counters
from crowd.devices.models import Installation
from crowd.http.problems import Problem
from crowd.results.models import MeasurementSession, Run, Submission

# The limits of an address, as a multiple of those of an installation.
ADDRESS_FACTOR = 4
# What a row adds to the database besides its columns: index entries, and rows derived from it, such as a
# run's summary or a description's device model.
ROW_BYTES = {Submission: 5_000, MeasurementSession: 1_500, Run: 1_000}
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
    """Count BODY before it is decoded. Raises Problem 429 above a limit."""
    _count(sender, BYTES, len(body))
    # Each value except the last of its list or object is followed by a comma.
    _count(sender, VALUES, body.count(b",") + 1)


def count_rows(sender: Sender, rows: Iterable[Model], description: dict[str, Any]) -> None:
    """Count how much ROWS, from a device with DESCRIPTION, will grow the database. Raises Problem 429."""
    if STORED.quota:
        _count(sender, STORED, database_growth(rows) + len(json.dumps(description)))


def database_growth(rows: Iterable[Model]) -> int:
    """An upper bound of the bytes that ROWS add to the database, with indexes and derived rows."""
    return sum(
        ROW_BYTES[type(row)]
        + _bytes_on_pages(
            sum(_column_bytes(getattr(row, field.attname)) for field in row._meta.concrete_fields)
        )
        for row in rows
    )


def _bytes_on_pages(content: int) -> int:
    """The bytes that a row of CONTENT bytes takes. Above half a page, the rest of the page stays empty."""
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


def _count(sender: Sender, limit: DailyLimit, amount: int) -> None:
    if not limit.quota or sender.installation.simulated:
        return
    counts = []
    with counters.tolerate_failure("amounts"):
        quotas = {f"installation:{sender.installation.pk}": limit.quota}
        if sender.address:
            quotas[f"address:{counters.hmac_identifier(sender.address)}"] = ADDRESS_FACTOR * limit.quota
        # Both are counted, even if the first is above its quota.
        counts = [
            (counters.count(f"daily-{limit.name}:{key}", counters.A_DAY, amount), quota)
            for key, quota in quotas.items()
        ]
    for count, quota in counts:
        if count.used > quota:
            wait = max(math.ceil(count.resets_in), 1)
            text = f"at most {quota} {limit.unit} a day: keep the results and send them in {wait} s"
            raise Problem("daily_limit", text, retry_after=wait)
