"""Rewrites stale files of exports without erased data, each once for all exports that share it.

A part is read from the database again, by the reader that wrote it and with the limits of its export. Only
the pseudonyms of installations come from the old file, because their key is not stored.
"""

import logging
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from django.db import transaction
from django.db.models import Case, Max, Q, QuerySet, When
from django.utils import timezone

from crowd.results.marking import DIGESTS, WHOLE_TABLES
from crowd.results.models import Export, ExportFile, FileChange, StoredFile
from crowd.results.opendata import description_files
from crowd.results.opendata.pseudonyms import EarlierPseudonyms
from crowd.results.opendata.reading import READERS, Scope
from crowd.results.opendata.storing import delete_unused, drafts, exports_lock, open_stored, storage
from crowd.results.opendata.tables import RUNS, TABLES

LOCK_PATIENCE_SECONDS = 1.0
PREFIX = ".rewriting-"  # of the folder in which files are written

log = logging.getLogger(__name__)


def rewrite_stale(files: QuerySet[ExportFile], seconds: float) -> bool:
    """Rewrite the stale `files` for about `seconds`. Returns whether none is left.

    Tries at least one. Small files of the newest export come first. Only one process rewrites at a time: if
    another one does, returns False after LOCK_PATIENCE_SECONDS.
    """
    end = time.monotonic() + seconds
    failed: set[int] = set()
    wanted = files.order_by().values("stored")
    stale = StoredFile.objects.filter(pk__in=wanted, stale=True).annotate(newest=Max("uses__export"))
    # Digests are those of the other files.
    last = Case(When(table__in=DIGESTS, then=1), default=0)
    while stored := stale.exclude(pk__in=failed).order_by(last, "-newest", "bytes", "pk").first():
        with exports_lock(LOCK_PATIENCE_SECONDS) as held:
            if not held:
                return False
            if not _try_rewrite(stored):
                failed.add(stored.pk)
        if time.monotonic() > end:
            return not stale.exists()
    return not failed


def _try_rewrite(stored: StoredFile) -> bool:
    """Rewrite `stored`. Returns False if it cannot be rewritten, and why goes to the log."""
    try:
        return _rewrite(stored)
    except OSError as error:
        log.warning("%s cannot be rewritten: %s", stored, error)
        return False


def _rewrite(stored: StoredFile) -> bool:
    """Replace `stored` and the files that are written with it.

    After another erasure meanwhile, the old files stay and are still stale. Returns False if they cannot be
    written yet.
    """
    use = stored.uses.select_related("export").order_by("export").last()
    if use is None:  # its exports were removed meanwhile
        return True
    for left in drafts().glob(f"{PREFIX}*"):  # by a process that was killed
        shutil.rmtree(left, ignore_errors=True)
    digests = stored.table in DIGESTS
    same = Q(stored__table__in=DIGESTS) if digests else Q(stored__table=stored.table, part=use.part)
    old = {row.stored.format: row.stored for row in use.export.files.filter(same)}
    if not old:
        return True
    with tempfile.TemporaryDirectory(prefix=PREFIX, dir=drafts()) as folder:
        if digests:
            new = description_files.updated(use.export, Path(folder))
        else:
            new = [row.stored for row in _write_part(use, list(old.values()), Path(folder))]
        if not new:
            return False
        _replace([(old[row.format], row) for row in new], Path(folder))
    return True


def _replace(pairs: Sequence[tuple[StoredFile, StoredFile]], folder: Path) -> None:
    """Let the first row of each of `pairs` have the content of the second, whose file is in `folder`."""
    for _, new in pairs:
        storage().take(folder / new.stored_as)
    with transaction.atomic():
        for old, new in pairs:
            if not _swap(old, new):
                transaction.set_rollback(True)
                break
    delete_unused({row.stored_as for pair in pairs for row in pair})


def _swap(old: StoredFile, new: StoredFile) -> bool:
    """Store the facts of `new` in the row of `old`, unless that was marked meanwhile."""
    unmarked = StoredFile.objects.filter(pk=old.pk, marked=old.marked)
    names = ("stored_as", "rows", "bytes", "sha256")
    if not unmarked.update(stale=False, reason="", **{name: getattr(new, name) for name in names}):
        return False
    # A file without a reason was never served with its old content.
    if old.reason and old.sha256 != new.sha256:
        FileChange.objects.create(
            stored=old,
            at=timezone.now(),
            reason=old.reason,
            old_sha256=old.sha256,
            new_sha256=new.sha256,
        )
    return True


def _write_part(use: ExportFile, old: Sequence[StoredFile], folder: Path) -> list[ExportFile]:
    """Write replacements of `old`, the part of `use`, to `folder`. Returns their unsaved rows."""
    # Arrow is slow to import, and only needed for writing.
    from crowd.results.opendata import writing

    [table] = [each for each in TABLES if each.name == old[0].table]
    return writing.write_part(table, READERS[table.name](_scope(use, old)), folder)


def _scope(use: ExportFile, old: Sequence[StoredFile]) -> Scope:
    """What the rows of `old`, the part of `use`, are read from."""
    [parquet] = [row for row in old if row.format == "parquet"]
    if parquet.table in WHOLE_TABLES:
        return Scope(parquet.until_session, parquet.until_run)
    first, last = parquet.first_session, parquet.last_session
    if first is None or last is None:
        return Scope(last_session=0, last_run=0)
    if parquet.table == RUNS.name:
        before = use.export.files.filter(stored__table=RUNS.name, part=use.part - 1).first()
        return Scope(last, parquet.until_run, first, before.stored.until_run + 1 if before else 0)
    if parquet.table != "sessions":
        return Scope(last, parquet.until_run, first)
    with open_stored(parquet) as sessions:
        return Scope(last, parquet.until_run, first, pseudonyms=EarlierPseudonyms(sessions))


def changes_of(export: Export) -> QuerySet[FileChange]:
    """The changes of the files of `export` since it was published, newest first."""
    return FileChange.objects.filter(stored__uses__export=export, at__gte=export.published_at)
