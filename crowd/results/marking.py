"""Marks files of the open data as stale: those with erased data, or with a device whose public name changed.

Call these functions in the transaction of the change. They lock the rows of all exports, after all other
locks. Publishing locks its own, so that no change is missed.
"""

from bisect import bisect_left
from collections.abc import Collection, Iterable

from django.db import transaction
from django.db.models import F
from django.dispatch import Signal

from crowd.results.models import Export, StoredFile

CHUNK = 500
# Tables that are rewritten as a whole: they are computed from many sessions, or list all erasures.
COMPUTED = ("figures", "devices")
TOMBSTONES = "tombstones"
WHOLE_TABLES = (*COMPUTED, TOMBSTONES)
# Descriptions that contain the digests of the other files of their export.
PACKAGE, SUMS = "datapackage", "sums"
DIGESTS = (PACKAGE, SUMS)
# Files of exports are stale. Sent after the transaction.
files_stale = Signal()


def mark_erased(sessions: Collection[int]) -> None:
    """Mark the files with `sessions` (keys), of which runs are erased in this transaction."""
    tables = ("runs", "run_states", "sessions", "summaries", *WHOLE_TABLES)
    _mark(sessions, StoredFile.Reason.ERASURE, tables)


def mark_devices_changed(sessions: Collection[int]) -> None:
    """Mark the files with `sessions` (keys), whose public device changes in this transaction."""
    _mark(sessions, StoredFile.Reason.DEVICE_NAMES, ("sessions", *COMPUTED))


def mark(files: Iterable[int], reason: str) -> None:
    """Mark the files with these keys. A file that holds erased data keeps that reason."""
    keys = list(files)
    for start in range(0, len(keys), CHUNK):
        chunk = StoredFile.objects.filter(pk__in=keys[start : start + CHUNK])
        if reason:
            chunk.exclude(reason=StoredFile.Reason.ERASURE).update(reason=reason)
        chunk.update(stale=True, marked=F("marked") + 1)


def _mark(sessions: Collection[int], reason: str, tables: Collection[str]) -> None:
    keys = sorted(sessions)
    marked = _mark_exports(keys, reason, tables, ())

    def after_commit() -> None:
        # An export that started before the commit may have read erased data.
        _mark_exports(keys, reason, tables, marked)
        files_stale.send(sender=Export)

    transaction.on_commit(after_commit)


@transaction.atomic
def _mark_exports(keys: list[int], reason: str, tables: Collection[str], known: Iterable[int]) -> list[int]:
    """Mark the files of all exports except `known`. Returns the keys of the exports."""
    rows = Export.objects.filter(removed_at=None).exclude(pk__in=list(known)).order_by("pk")
    exports = dict(rows.select_for_update(no_key=True).values_list("pk", "published_at"))
    unfinished = [key for key, published_at in exports.items() if published_at is None]
    Export.objects.filter(pk__in=unfinished).update(changed_while_written=True)
    files = StoredFile.objects.filter(uses__export__in=exports).order_by().distinct()
    columns = ("pk", "table", "first_session", "last_session", "until_session")
    stale = [
        key
        for key, table, first, last, until in files.filter(table__in=tables).values_list(*columns)
        if table == TOMBSTONES or _any_between(keys, *((0, until) if table in COMPUTED else (first, last)))
    ]
    if stale:
        stale += files.filter(table__in=DIGESTS).values_list("pk", flat=True)
    mark(stale, reason)
    return list(exports)


def _any_between(keys: list[int], first: int | None, last: int | None) -> bool:
    """Whether one of the sorted `keys` is between `first` and `last`. False without rows (None)."""
    if first is None or last is None:
        return False
    index = bisect_left(keys, first)
    return index < len(keys) and keys[index] <= last
