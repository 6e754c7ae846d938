"""Exports of the open data: when one is due, how it is created, how long it is kept.

Erased data is removed from the files that contain it (`marking`, `rewriting`). Exports are never withdrawn.
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
from crowd.results.opendata.rewriting import delete_unused_files, exports_folder, rewrite_stale
from crowd.results.opendata.tables import TABLES

NIGHT_HOUR = 2  # UTC
# An export without progress for this long was abandoned by its process.
ABANDONED_AFTER = timedelta(minutes=10)
# How long the server remembers an export that an earlier version withdrew.
KEEP_WITHDRAWN = timedelta(days=30)
MAX_TRIES = 3
# How long the worker rewrites stale files at a time.
REWRITING_SECONDS = 60.0


class AbandonedError(Exception):
    """Another process considered the export abandoned and deleted its files."""


def export_if_due() -> Export | None:
    """Create an export if none exists since last night and none is in progress.

    Also cleans up and rewrites.
    """
    clean_up()
    rewrite_all()
    return create_export() if _due(timezone.now()) else None


def create_export() -> Export:
    """Create and publish an export, and delete the oldest ones above FRONTRUNNER_EXPORTS_KEPT.

    Files with data that was erased meanwhile are rewritten. Raises AbandonedError if each of MAX_TRIES
    attempts was considered abandoned, OSError without disk space.
    """
    for attempt in range(1, MAX_TRIES + 1):
        try:
            export = _try_export()
        except AbandonedError:
            if attempt == MAX_TRIES:
                raise
        else:
            _delete_surplus()
            clean_up()
            rewrite_stale(ExportFile.objects.filter(export=export), REWRITING_SECONDS)
            return export
    raise AssertionError("the last attempt returns or raises")


def published_exports() -> QuerySet[Export]:
    """The exports that are served, newest first."""
    return Export.objects.exclude(published_at=None).filter(withdrawn_at=None)


def listed_exports() -> list[Export]:
    """The newest export of each day, newest first, with its files. Addresses lead to these."""
    by_day: dict[str, Export] = {}
    for export in published_exports().prefetch_related("files"):
        by_day.setdefault(export.name, export)
    return list(by_day.values())


def exports_of_day(day: str, rows: QuerySet[Export]) -> QuerySet[Export]:
    """Those of `rows` that were created on `day`; none if `day` is not a date."""
    try:
        created_on = date.fromisoformat(day)
    except ValueError:
        return rows.none()
    if created_on.isoformat() != day:
        return rows.none()
    return rows.filter(
        started_at__range=(
            datetime.combine(created_on, time.min, UTC),
            datetime.combine(created_on, time.max, UTC),
        )
    )


def rewrite_all(seconds: float = REWRITING_SECONDS) -> bool:
    """Rewrite stale files of all published exports, for about `seconds`. Returns whether none is left."""
    return rewrite_stale(ExportFile.objects.all(), seconds)


def clean_up() -> None:
    """Delete old rows, abandoned exports, and files that do not belong to an export."""
    Export.objects.filter(withdrawn_at__lt=timezone.now() - KEEP_WITHDRAWN).delete()
    unfinished = Export.objects.filter(published_at=None)
    unfinished.filter(touched_at__lt=timezone.now() - ABANDONED_AFTER).delete()
    # Folders first: a new export has its row before its folder.
    folders = list(exports_folder().iterdir()) if exports_folder().is_dir() else []
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
        published_exports().filter(started_at__range=(night, now)).exists()
        or unfinished.filter(touched_at__range=(now - ABANDONED_AFTER, now + ABANDONED_AFTER)).exists()
    )


def _try_export() -> Export:
    # The row is stored before anything is read, so that an erasure finds it.
    export = Export.objects.create(started_at=timezone.now(), touched_at=timezone.now())
    draft, final = exports_folder() / f".{export.folder}", exports_folder() / export.folder
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
    """Publish `export`. Raises AbandonedError if its row is gone."""
    with transaction.atomic():
        # An erasure in progress locks this row: the mark is visible after its commit.
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
    """Write the tables into `folder`. Returns the unsaved rows of their files."""
    # Arrow is slow to import, and only needed for writing.
    from crowd.results.opendata import writing

    return [
        file
        for table in TABLES
        for file in writing.write_table(table, _with_heartbeat(export, READERS[table.name](scope)), folder)
    ]


def _with_heartbeat(export: Export, blocks: Iterable[Block]) -> Iterator[Block]:
    """`blocks`, with a heartbeat for each. Raises AbandonedError if the row of `export` is gone."""
    for block in blocks:
        if not Export.objects.filter(pk=export.pk).update(touched_at=timezone.now()):
            raise AbandonedError
        yield block


def _delete_surplus() -> None:
    kept = published_exports().values_list("pk", flat=True)[: settings.FRONTRUNNER_EXPORTS_KEPT]
    published_exports().exclude(pk__in=list(kept)).delete()
