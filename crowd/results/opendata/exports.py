"""Exports of the open data: when one is due, how it is created, what is deleted.

Erased data is removed from the files that contain it (`marking`, `rewriting`). `releases` says which exports
stay.
"""

import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

from django.db import transaction
from django.utils import timezone

from crowd.results.marking import DIGESTS
from crowd.results.models import Export, ExportFile, StoredFile
from crowd.results.opendata import description_files, releases
from crowd.results.opendata.reading import READERS, Block, Scope
from crowd.results.opendata.rewriting import rewrite_stale
from crowd.results.opendata.storing import delete_unused, drafts, exports_lock, share, storage
from crowd.results.opendata.tables import RUNS, TABLES

NIGHT_HOUR = 2  # UTC
# An export without progress for this long was abandoned by its process.
ABANDONED_AFTER = timedelta(minutes=10)
MAX_TRIES = 3
# How long the worker rewrites stale files at a time, and how long a new export waits for the lock.
REWRITING_SECONDS = 60.0
PUBLISHING_PATIENCE_SECONDS = 600.0


class AbandonedError(Exception):
    """Another process considered the export abandoned, or deleted files that it shares."""


def export_if_due() -> Export | None:
    """Create an export if none exists since last night and none is in progress.

    Also cleans up and rewrites.
    """
    clean_up()
    rewrite_all()
    return create_export() if _due(timezone.now()) else None


def create_export() -> Export:
    """Create and publish an export, and remove those that it replaces.

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
            releases.remove_surplus()
            clean_up()
            rewrite_stale(ExportFile.objects.filter(export=export), REWRITING_SECONDS)
            return export
    raise AssertionError("the last attempt returns or raises")


def rewrite_all(seconds: float = REWRITING_SECONDS) -> bool:
    """Rewrite stale files of all exports, for about `seconds`. Returns whether none is left."""
    return rewrite_stale(ExportFile.objects.all(), seconds)


def clean_up() -> None:
    """Delete abandoned exports, and files that do not belong to an export."""
    unfinished = Export.objects.filter(published_at=None)
    unfinished.filter(touched_at__lt=timezone.now() - ABANDONED_AFTER).delete()
    with exports_lock(0) as held:
        if not held:
            return
        # Folders and files first: a new export has its row before its folder.
        folders = [path for path in drafts().iterdir() if path.is_dir()]
        _, names = storage().listdir("")
        live = {_draft(row) for row in Export.objects.filter(published_at=None)}
        for folder in (path for path in folders if path not in live):
            shutil.rmtree(folder, ignore_errors=True)
        StoredFile.objects.filter(uses=None).delete()
        delete_unused(names)


def _due(now: datetime) -> bool:
    night = now.replace(hour=NIGHT_HOUR, minute=0, second=0, microsecond=0)
    if night > now:
        night -= timedelta(days=1)
    unfinished = Export.objects.filter(published_at=None)
    return not (
        releases.published_exports().filter(started_at__range=(night, now)).exists()
        or unfinished.filter(touched_at__range=(now - ABANDONED_AFTER, now + ABANDONED_AFTER)).exists()
    )


def _draft(export: Export) -> Path:
    """The folder in which the files of `export` are written."""
    return drafts() / f".export-{export.pk}"


def _try_export() -> Export:
    # The row is stored before anything is read, so that an erasure finds it.
    export = Export.objects.create(started_at=timezone.now(), touched_at=timezone.now())
    draft = _draft(export)
    try:
        scope = Scope.now()
        export.last_session, export.last_run = scope.last_session, scope.last_run
        draft.mkdir(parents=True)
        files = _write(export, scope, draft)
        with exports_lock(PUBLISHING_PATIENCE_SECONDS) as held:
            if not held:
                raise AbandonedError
            releases.give_address(export)
            _refresh_shared(files)
            files += description_files.write(export, files, draft)
            for new in (file.stored for file in files if file.stored.pk is None):
                _touch(export)
                storage().take(draft / new.stored_as)
            _publish(export, files)
    except BaseException as error:
        deleted, _ = Export.objects.filter(pk=export.pk).delete()
        if isinstance(error, OSError) and not deleted:
            raise AbandonedError from error
        raise
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return export


@transaction.atomic
def _publish(export: Export, files: list[ExportFile]) -> None:
    """Publish `export` with its `files`, new ones and those of earlier exports. Their contents are stored.

    Raises AbandonedError if its row or a shared file is gone.
    """
    # An erasure in progress locks this row: the mark is visible after its commit.
    held = Export.objects.select_for_update(no_key=True).filter(pk=export.pk).first()
    if held is None:
        raise AbandonedError
    export.published_at = timezone.now()
    export.changed_while_written = held.changed_while_written
    export.save()
    # Data that is erased from now on is marked in the shared files, too, if they are still in use.
    _refresh_shared(files)
    written = [file for file in files if file.stored.pk is None]
    for file in written:
        file.stored = share(file.stored)
    for file in files:
        file.export = export
    ExportFile.objects.bulk_create(files)
    if export.changed_while_written:
        tables = [file.stored.pk for file in written if file.stored.table in READERS]
        StoredFile.objects.filter(pk__in=tables).update(stale=True)
    if StoredFile.objects.filter(uses__export=export, stale=True).exists():
        digests = StoredFile.objects.filter(uses__export=export, table__in=DIGESTS)
        StoredFile.objects.filter(pk__in=digests.values("pk")).update(stale=True)


def _refresh_shared(files: list[ExportFile]) -> None:
    """Read those of `files` again that earlier exports have: they may have been rewritten.

    Raises AbandonedError if one is gone.
    """
    files = [file for file in files if file.stored.pk is not None]
    keys = [file.stored.pk for file in files]
    # Erased data is marked in files that an export uses.
    stored = StoredFile.objects.exclude(uses=None).in_bulk(keys)
    if len(stored) < len(keys):
        raise AbandonedError
    for file in files:
        file.stored = stored[file.stored.pk]


def _write(export: Export, scope: Scope, folder: Path) -> list[ExportFile]:
    """Write the tables into `folder`, except for parts of runs that earlier exports have.

    Returns the unsaved rows of their files.
    """
    # Arrow is slow to import, and only needed for writing.
    from crowd.results.opendata import run_parts, writing

    shared = run_parts.shared_parts(scope.last_run)
    scope = replace(scope, first_run=run_parts.covered(shared) + 1)
    files = [
        file
        for table in TABLES
        for file in writing.write_table(
            table,
            _with_heartbeat(export, READERS[table.name](scope)),
            folder,
            shared if table is RUNS else (),
        )
    ]
    for stored in (file.stored for file in files if file.stored.pk is None):
        stored.until_session = scope.last_session
        stored.until_run = stored.until_run or scope.last_run
    return files


def _with_heartbeat(export: Export, blocks: Iterable[Block]) -> Iterator[Block]:
    """`blocks`, with a heartbeat for each. Raises AbandonedError as `_touch` does."""
    for block in blocks:
        _touch(export)
        yield block


def _touch(export: Export) -> None:
    """Store that `export` is still being made. Raises AbandonedError if its row is gone."""
    if not Export.objects.filter(pk=export.pk).update(touched_at=timezone.now()):
        raise AbandonedError
