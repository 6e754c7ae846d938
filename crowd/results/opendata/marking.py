"""Marks the files of exports that hold something which was erased, or a device that is shown differently now.

Call these functions in the transaction of the change itself. They lock the rows of all exports, after every
other lock: publishing and rewriting lock them too, so that a change is never missed in between.
"""

from bisect import bisect_left
from collections.abc import Collection, Iterable

from django.db import transaction
from django.db.models import F

from crowd.results.models import Export, ExportFile
from crowd.results.opendata.signals import files_stale

AT_ONCE = 500
# Computed from many sessions, or about the erasure itself: no key range says what they hold.
WHOLE_TABLES = ("figures", "devices", "tombstones")


def mark_erased(sessions: Collection[int]) -> None:
    """All or some runs of SESSIONS (primary keys) are erased in this transaction."""
    _mark(sessions, ("runs", "sessions", "summaries"), WHOLE_TABLES)


def mark_devices_changed(sessions: Collection[int]) -> None:
    """From this transaction on the public sees other devices for SESSIONS (primary keys)."""
    _mark(sessions, ("sessions",), ("figures", "devices"))


def _mark(sessions: Collection[int], of_sessions: Collection[str], whole: Collection[str]) -> None:
    keys = sorted(sessions)
    marked = _mark_exports(keys, of_sessions, whole, ())

    def after_commit() -> None:
        # An export that began before the commit may have read what is gone now.
        _mark_exports(keys, of_sessions, whole, marked)
        files_stale.send(sender=Export)

    transaction.on_commit(after_commit)


@transaction.atomic
def _mark_exports(
    keys: list[int], of_sessions: Collection[str], whole: Collection[str], known: Iterable[int]
) -> list[int]:
    """Mark the files of all exports but those KNOWN; the primary keys of the exports."""
    rows = Export.objects.filter(withdrawn_at=None).exclude(pk__in=list(known)).order_by("pk")
    exports = dict(rows.select_for_update(no_key=True).values_list("pk", "published_at"))
    unfinished = [key for key, published_at in exports.items() if published_at is None]
    Export.objects.filter(pk__in=unfinished).update(changed_while_written=True)
    files = ExportFile.objects.filter(export__in=exports)
    ranges = files.filter(table__in=of_sessions).values_list("pk", "first_session", "last_session")
    stale = [key for key, first, last in ranges if _holds(keys, first, last)]
    stale += files.filter(table__in=whole).values_list("pk", flat=True)
    for start in range(0, len(stale), AT_ONCE):
        part = ExportFile.objects.filter(pk__in=stale[start : start + AT_ONCE])
        part.update(stale=True, marked=F("marked") + 1)
    return list(exports)


def _holds(keys: list[int], first: int | None, last: int | None) -> bool:
    """Whether one of the sorted KEYS lies between FIRST and LAST; None: the part has no rows."""
    if first is None or last is None:
        return False
    place = bisect_left(keys, first)
    return place < len(keys) and keys[place] <= last
