"""Rewrites stale files of exports without erased data.

A part is read from the database again, by the reader that wrote it and with the limits of its export. Only
the pseudonyms of installations come from the old file, because their key is not stored.
"""

import fcntl
import logging
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import UUID

from django.conf import settings
from django.db import transaction
from django.db.models import QuerySet

from crowd.results.models import Export, ExportFile
from crowd.results.opendata.marking import WHOLE_TABLES
from crowd.results.opendata.reading import PSEUDONYM_LENGTH, READERS, Pseudonym, Scope
from crowd.results.opendata.tables import TABLES

LOCK_PATIENCE_SECONDS = 1.0
LOCK_POLL_SECONDS = 0.05

log = logging.getLogger(__name__)


def exports_folder() -> Path:
    """The folder of all exports, in which each has its own folder."""
    return Path(settings.FRONTRUNNER_VAR) / "exports"


def rewrite_stale(files: QuerySet[ExportFile], seconds: float) -> bool:
    """Rewrite the stale `files` for about `seconds`. Returns whether none is left.

    Tries at least one. Small files of the newest export come first. Only one process rewrites at a time: if
    another one does, returns False after LOCK_PATIENCE_SECONDS.
    """
    end = time.monotonic() + seconds
    failed: list[int] = []
    stale = files.filter(stale=True).select_related("export").order_by("-export", "bytes", "pk")
    while file := stale.exclude(pk__in=failed).first():
        with rewriting_lock(LOCK_PATIENCE_SECONDS) as held:
            if not held:
                return False
            try:
                _rewrite(file)
            except OSError as error:
                log.warning("%s cannot be rewritten: %s", file, error)
                failed.append(file.pk)
        if time.monotonic() > end:
            return not stale.exists()
    return not failed


@contextmanager
def rewriting_lock(seconds: float) -> Iterator[bool]:
    """Lock the files of published exports; waits for at most `seconds`. Yields whether the lock is held."""
    end = time.monotonic() + seconds
    exports_folder().mkdir(parents=True, exist_ok=True)
    with exports_folder().with_suffix(".lock").open("w") as file:
        while not (held := _try_lock(file.fileno())) and time.monotonic() < end:
            time.sleep(LOCK_POLL_SECONDS)
        yield held  # closing the file releases the lock


def delete_unused_files() -> None:
    """Delete leftovers of interrupted rewriting, unless one is in progress."""
    with rewriting_lock(0) as held:
        if not held:
            return
        for export in Export.objects.filter(withdrawn_at=None).exclude(published_at=None):
            used = set(export.files.values_list("stored_as", flat=True))
            folder = exports_folder() / export.folder
            for path in folder.iterdir() if folder.is_dir() else ():
                if path.name not in used:
                    path.unlink(missing_ok=True)


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _rewrite(file: ExportFile) -> None:
    """Replace the part of `file`, or its whole table if that is one of WHOLE_TABLES.

    After another erasure meanwhile, the old files stay and are still stale.
    """
    export = file.export
    same = export.files.filter(table=file.table)
    if file.table not in WHOLE_TABLES:
        same = same.filter(part=file.part)
    old = list(same)
    new = _write_part(export, old)
    with transaction.atomic():
        held = Export.objects.select_for_update(no_key=True).filter(pk=export.pk, withdrawn_at=None)
        marks = {row.pk: row.marked for row in old}
        replaced = bool(old and list(held)) and dict(same.values_list("pk", "marked")) == marks
        if replaced:
            same.delete()
            ExportFile.objects.bulk_create(new)
    for each in old if replaced else new:
        (exports_folder() / export.folder / each.stored_as).unlink(missing_ok=True)


def _write_part(export: Export, old: list[ExportFile]) -> list[ExportFile]:
    """Write replacements of `old`. Returns their unsaved rows."""
    # Arrow is slow to import, and only needed for writing.
    from crowd.results.opendata import writing

    if not old:  # rewritten by another process meanwhile
        return []
    [table] = [each for each in TABLES if each.name == old[0].table]
    folder = exports_folder() / export.folder
    if table.name in WHOLE_TABLES:
        blocks = READERS[table.name](Scope(export.last_session, export.last_run))
        new = writing.write_table(table, blocks, folder)
    else:
        new = writing.write_part(table, READERS[table.name](_scope_of_part(export, old)), folder)
        by_format = {row.format: row for row in old}
        for file in new:
            before = by_format[file.format]
            file.part, file.name = before.part, before.name
            file.first_session, file.last_session = before.first_session, before.last_session
    for file in new:
        file.export = export
    return new


def _scope_of_part(export: Export, old: list[ExportFile]) -> Scope:
    first, last = old[0].first_session, old[0].last_session
    if first is None or last is None:
        return Scope(last_session=0, last_run=0)
    if old[0].table != "sessions":
        return Scope(last, export.last_run, first)
    [parquet] = [row for row in old if row.format == "parquet"]
    return Scope(
        last, export.last_run, first, _pseudonyms_in(exports_folder() / export.folder / parquet.stored_as)
    )


def _pseudonyms_in(path: Path) -> Pseudonym:
    """The pseudonyms of installations in the file of sessions at `path`.

    Raises FileNotFoundError if the file is on another machine.
    """
    import pyarrow.parquet

    columns = pyarrow.parquet.read_table(path, columns=["session", "installation"])
    names = dict(zip(*(column.to_pylist() for column in columns.columns), strict=True))

    def pseudonym(session: UUID, installation: UUID) -> str:  # noqa: ARG001 - looked up by session
        # A session that the file lacks arrived later: it gets a new pseudonym.
        return str(names.get(str(session)) or secrets.token_hex(PSEUDONYM_LENGTH // 2))

    return pseudonym
