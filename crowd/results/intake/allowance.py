"""What one installation, and one address, may send in a day: bytes, values, and growth of the database.

Bytes and values are counted before anything is decoded, also of requests that are refused afterwards. Growth
is counted before anything is stored. Simulated installations are not limited: an administrator permits them.
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

# An address may send as much as so many installations.
PER_ADDRESS = 4
# What a row adds to the database besides the content of its own columns: its place in the indexes, and the
# rows that are derived from it, such as a run's summary or a description's device model.
ROW_BYTES = {Submission: 5_000, MeasurementSession: 1_500, Run: 1_000}
COLUMN_BYTES = 8
PAGE_BYTES = 4096  # of SQLite


@dataclass(frozen=True)
class Sender:
    """Who sends: an installation, its address as the server sees it (never stored; empty: not counted),
    and the keyed hash of its network (empty: not known).
    """

    installation: Installation
    address: str = ""
    network: str = ""


@dataclass(frozen=True)
class Allowance:
    """An amount that is limited a day; SETTING has that of one installation, 0: no limit."""

    name: str
    setting: str
    unit: str

    @property
    def quota(self) -> int:
        """How much one installation may send in a day."""
        return int(getattr(settings, self.setting))


BYTES = Allowance("bytes", "FRONTRUNNER_BYTES_PER_DAY", "bytes after gzip")
VALUES = Allowance("values", "FRONTRUNNER_VALUES_PER_DAY", "values")
STORED = Allowance("stored", "FRONTRUNNER_STORED_BYTES_PER_DAY", "bytes in the database")


def in_force() -> list[Allowance]:
    """The daily limits of this deployment, for people to read."""
    return [allowance for allowance in (BYTES, VALUES, STORED) if allowance.quota]


def charge_body(sender: Sender, body: bytes) -> None:
    """Count BODY, before it is decoded. Raises Problem 429."""
    _charge(sender, BYTES, len(body))
    # Every value but the last of its list or object has a comma behind it.
    _charge(sender, VALUES, body.count(b",") + 1)


def charge_rows(sender: Sender, rows: Iterable[Model], description: dict[str, Any]) -> None:
    """Count what storing ROWS of a device with that DESCRIPTION adds to the database. Raises Problem 429."""
    if STORED.quota:
        _charge(sender, STORED, growth(rows) + len(json.dumps(description)))


def growth(rows: Iterable[Model]) -> int:
    """The bytes by which ROWS make the database grow at most, with indexes and what is derived of them."""
    return sum(
        ROW_BYTES[type(row)]
        + _on_pages(sum(_size(getattr(row, field.attname)) for field in row._meta.concrete_fields))
        for row in rows
    )


def _on_pages(content: int) -> int:
    """What a row with so much CONTENT takes: one of more than half a page leaves the rest of a page empty."""
    if content > PAGE_BYTES:
        return content + PAGE_BYTES // 2
    return PAGE_BYTES if content > PAGE_BYTES // 2 else content


def _size(value: Any) -> int:
    match value:
        case bytes():
            return len(value)
        case str():
            return len(value.encode())
        case dict() | list():
            return len(json.dumps(value))
    return COLUMN_BYTES


def _charge(sender: Sender, allowance: Allowance, amount: int) -> None:
    if not allowance.quota or sender.installation.simulated:
        return
    counts = []
    with counters.counting("amounts"):
        quotas = {f"installation:{sender.installation.pk}": allowance.quota}
        if sender.address:
            quotas[f"address:{counters.disguised(sender.address)}"] = PER_ADDRESS * allowance.quota
        # Both are counted even where the first is used up.
        counts = [
            (counters.count(f"daily-{allowance.name}:{key}", counters.A_DAY, amount), quota)
            for key, quota in quotas.items()
        ]
    for count, quota in counts:
        if count.used > quota:
            wait = max(math.ceil(count.resets_in), 1)
            text = f"at most {quota} {allowance.unit} a day: keep the results and send them in {wait} s"
            raise Problem(429, "daily_limit", text, retry_after=wait)
