"""Exports of the open data: when one is due, how it is made, how long it is kept.

What is erased disappears from the files that hold it (`marking`, `rewriting`); nothing else is withdrawn.
"""

import os
import shutil
from collections.abc import Iterable, Iterator
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path

from django.conf import settings
from django.db import transaction
from django.db.models import QuerySet
from django.utils import timezone

from crowd.results.models import Export, ExportFile
from crowd.results.opendata.reading import READERS, Block, Scope
from crowd.results.opendata.rewriting import delete_unused_files, rewrite_stale, root
from crowd.results.opendata.tables import TABLES

NIGHT_HOUR = 2  # UTC
# An export without progress for this long belongs to a process that died.
DEAD_AFTER = timedelta(minutes=10)
# How long the address of an export that an earlier version withdrew says so.
WITHDRAWN_KEPT = timedelta(days=30)
TRIES = 3
# How long the worker rewrites stale files without a break.
REWRITING_SECONDS = 60.0


class AbandonedError(Exception):
    """Another process took the writer of an export for dead and deleted what it had written."""


def make_if_due() -> Export | None:
    """An export, if none was made since the night and none is being made. Cleans up and rewrites, too."""
    sweep()
    rewrite_all()
    return make() if _due(timezone.now()) else None


def make() -> Export:
    """A new export, published when it is complete; those beyond the number to keep are deleted.

    What is erased meanwhile is written again before this returns. Raises AbandonedError when each of TRIES
    attempts was taken for dead, OSError without space.
    """
    for attempt in range(1, TRIES + 1):
        try:
            export = _make()
        except AbandonedError:
            if attempt == TRIES:
                raise
        else:
            _delete_surplus()
            sweep()
            rewrite_stale(ExportFile.objects.filter(export=export), REWRITING_SECONDS)
            return export
    raise AssertionError("the last attempt returns or raises")


def published() -> QuerySet[Export]:
    """Exports that are served, newest first."""
    return Export.objects.exclude(published_at=None).filter(withdrawn_at=None)


def listed() -> list[Export]:
    """The newest export of each day, newest first, with its files: the ones that addresses lead to."""
    by_day: dict[str, Export] = {}
    for export in published().prefetch_related("files"):
        by_day.setdefault(export.name, export)
    return list(by_day.values())


def made_on(day: str, rows: QuerySet[Export]) -> QuerySet[Export]:
    """The exports among ROWS that were made on DAY; none where DAY is not a date."""
    try:
        found = date.fromisoformat(day)
    except ValueError:
        return rows.none()
    if found.isoformat() != day:
        return rows.none()
    return rows.filter(
        started_at__range=(datetime.combine(found, time.min, UTC), datetime.combine(found, time.max, UTC))
    )


def rewrite_all(seconds: float = REWRITING_SECONDS) -> bool:
    """Rewrite the stale files of all published exports, for about SECONDS; whether none is left."""
    return rewrite_stale(ExportFile.objects.all(), seconds)


def sweep() -> None:
    """Delete old rows, exports whose process died, and files that belong to no export."""
    Export.objects.filter(withdrawn_at__lt=timezone.now() - WITHDRAWN_KEPT).delete()
    unfinished = Export.objects.filter(published_at=None)
    unfinished.filter(touched_at__lt=timezone.now() - DEAD_AFTER).delete()
    # Folders first: an export that begins meanwhile has its row before its folder.
    folders = list(root().iterdir()) if root().is_dir() else []
    live = {row.folder for row in Export.objects.filter(withdrawn_at=None)}
    for folder in folders:
        if folder.name.lstrip(".") not in live:
            shutil.rmtree(folder, ignore_errors=True)
    delete_unused_files()


def _due(now: datetime) -> bool:
    night = now.replace(hour=NIGHT_HOUR, minute=0, second=0, microsecond=0)
    if night > now:
        night -= timedelta(days=1)
    unfinished = Export.objects.filter(published_at=None, withdrawn_at=None)
    return not (
        published().filter(started_at__gte=night).exists()
        or unfinished.filter(touched_at__gt=now - DEAD_AFTER).exists()
    )


def _make() -> Export:
    # The row comes before anything is read, so that an erasure finds it.
    export = Export.objects.create(started_at=timezone.now(), touched_at=timezone.now())
    draft, final = root() / f".{export.folder}", root() / export.folder
    try:
        scope = Scope.now()
        export.last_session, export.last_run = scope.last_session, scope.last_run
        draft.mkdir(parents=True)
        files = _write(export, scope, draft)
        os.replace(draft, final)
        _publish(export, files)
    except BaseException as error:
        for folder in (draft, final):
            shutil.rmtree(folder, ignore_errors=True)
        deleted, _ = Export.objects.filter(pk=export.pk).delete()
        if isinstance(error, OSError) and not deleted:
            raise AbandonedError from error
        raise
    return export


def _publish(export: Export, files: list[ExportFile]) -> None:
    """Serve EXPORT from now on. Raises AbandonedError where its row is gone."""
    with transaction.atomic():
        # An erasure that is not committed yet holds this row: its mark is seen once it lets go.
        held = Export.objects.select_for_update(no_key=True).filter(pk=export.pk).first()
        if held is None:
            raise AbandonedError
        export.published_at = timezone.now()
        export.changed_while_written = held.changed_while_written
        export.save()
        for file in files:
            file.export, file.stale = export, held.changed_while_written
        ExportFile.objects.bulk_create(files)


def _write(export: Export, scope: Scope, folder: Path) -> list[ExportFile]:
    """The tables in FOLDER; the unsaved rows of their files."""
    # Arrow takes time to load: only those who write need it.
    from crowd.results.opendata import writing

    return [
        file
        for table in TABLES
        for file in writing.write_table(table, _touching(export, READERS[table.name](scope)), folder)
    ]


def _touching(export: Export, blocks: Iterable[Block]) -> Iterator[Block]:
    """BLOCKS, with a sign of life for each. Raises AbandonedError where the row of EXPORT is gone."""
    for block in blocks:
        if not Export.objects.filter(pk=export.pk).update(touched_at=timezone.now()):
            raise AbandonedError
        yield block


def _delete_surplus() -> None:
    kept = published().values_list("pk", flat=True)[: settings.FRONTRUNNER_EXPORTS_KEPT]
    published().exclude(pk__in=list(kept)).delete()
