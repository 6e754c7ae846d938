"""How many rows the growing tables have, stored so that /metrics need not count them.

A worker counts, not the statements that insert and delete: a total that every submission updates would make
them wait for each other. The count is exact at its time, whatever was erased before.
"""

import time
from collections.abc import Iterator
from datetime import datetime, timedelta

from django.db.models import Model
from django.utils import timezone

from crowd.devices.models import DeviceModel, Installation
from crowd.observability.metrics import gauge, label
from crowd.results.models import MeasurementSession, RowCount, Run, Submission

COUNTED: dict[str, tuple[type[Model], str]] = {
    "installations": (Installation, "Enrolled installations"),
    "devices": (DeviceModel, "Device models"),
    "submissions": (Submission, "Accepted submissions"),
    "sessions": (MeasurementSession, "Measurement sessions"),
    "runs": (Run, "Runs"),
}
# After counting a table for a second, a worker does not count it for this many seconds.
PAUSE_PER_SECOND = 100


def count_if_due() -> None:
    """Count each table, unless its last count took long and is recent."""
    earlier = {row.table: row for row in RowCount.objects.all()}
    for table, (model, _) in COUNTED.items():
        if table in earlier and not _is_due(earlier[table]):
            continue
        begun = time.perf_counter()
        rows = model._default_manager.count()
        RowCount.objects.update_or_create(
            table=table,
            defaults={"rows": rows, "at": timezone.now(), "seconds": time.perf_counter() - begun},
        )


def gauges() -> Iterator[str]:
    """The stored counts with their ages; a table that was not counted yet has no value."""
    stored = {row.table: row for row in RowCount.objects.filter(table__in=COUNTED)}
    for table, (_, text) in COUNTED.items():
        yield gauge(table, text, {"": stored[table].rows} if table in stored else {})
    ages = {label("table", table): _age(row.at).total_seconds() for table, row in stored.items()}
    yield gauge("count_age_seconds", "Since a worker counted the rows of this table", ages)


def _is_due(earlier: RowCount) -> bool:
    # A count from the future was made before the clock was set back.
    waited = timezone.now() - earlier.at
    return waited < timedelta(0) or waited >= timedelta(seconds=PAUSE_PER_SECOND * earlier.seconds)


def _age(moment: datetime) -> timedelta:
    return max(timedelta(0), timezone.now() - moment)
