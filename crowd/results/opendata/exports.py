"""Exports of the open data: when one is due, how it is made, what ends it.

A file is never changed. When something in an export is erased, the whole export is withdrawn with the same
transaction and its files are deleted; the next one, made within minutes, lacks what was erased.
"""

import hashlib
import json
import os
import shutil
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path
from typing import Any

from django.conf import settings
from django.db import transaction
from django.db.models import Q, QuerySet
from django.utils import timezone

from crowd.results.models import Export, Tombstone
from crowd.results.opendata.reading import READERS, Scope
from crowd.results.opendata.tables import LICENCE, TABLES, data_package

NIGHT_HOUR = 2  # UTC
# An export that was not written on for so long belongs to a process that died.
DEAD_AFTER = timedelta(minutes=10)
# For so long the address of a withdrawn export says that it was withdrawn.
WITHDRAWN_KEPT = timedelta(days=30)
TRIES = 3
LICENCE_TEXT = """\
These measurements are licensed under {title} ({name}):
{path}

You may share and adapt them for any purpose if you name their source: the Frontrunner server that you
have them from, and the day of the export. datapackage.json says what each column means.
tombstones lists what participants have erased: please delete it from earlier copies.
"""


class ErasedMeanwhileError(Exception):
    """Something was erased while an export was written: what was written does not count."""


def make_if_due() -> Export | None:
    """An export, if none was made since the night and none is being made; and no files of ended ones."""
    sweep()
    return make() if _due(timezone.now()) else None


def make() -> Export:
    """A new export, published when it is whole; those beyond the number to keep end.

    Raises ErasedMeanwhileError when somebody erased something during each of TRIES attempts, OSError
    without space.
    """
    for attempt in range(1, TRIES + 1):
        try:
            export = _make()
        except ErasedMeanwhileError:
            if attempt == TRIES:
                raise
        else:
            _end_surplus()
            sweep()
            return export
    raise AssertionError("the last attempt returns or raises")


def published() -> QuerySet[Export]:
    """Exports that can be had, newest first."""
    return Export.objects.exclude(published_at=None).filter(withdrawn_at=None)


def listed() -> list[Export]:
    """The newest export of each day, newest first: the ones that addresses lead to."""
    by_day: dict[str, Export] = {}
    for export in published():
        by_day.setdefault(export.name, export)
    return list(by_day.values())


def made_on(day: str, rows: QuerySet[Export]) -> QuerySet[Export]:
    """Those of ROWS that bear the name DAY; none where that is no day."""
    try:
        found = date.fromisoformat(day)
    except ValueError:
        return rows.none()
    if found.isoformat() != day:
        return rows.none()
    return rows.filter(
        started_at__range=(datetime.combine(found, time.min, UTC), datetime.combine(found, time.max, UTC))
    )


def withdraw(since: datetime) -> None:
    """End every export that may hold what was received at SINCE; call it in the erasing transaction."""
    ended = _end(since)

    def once_more() -> None:
        # Where readers do not wait for writers, an export that began meanwhile has read what is gone now.
        if _end(since) or ended:
            sweep()

    transaction.on_commit(once_more)


def _end(since: datetime) -> int:
    rows = Export.objects.filter(withdrawn_at=None)
    held = rows.filter(Q(published_at=None) | Q(published_at__gte=since))
    return held.update(withdrawn_at=timezone.now())


def sweep() -> None:
    """Delete the folders of exports that ended, were withdrawn, or whose process died, and old rows."""
    Export.objects.filter(withdrawn_at__lt=timezone.now() - WITHDRAWN_KEPT).delete()
    unfinished = Export.objects.filter(published_at=None)
    unfinished.filter(touched_at__lt=timezone.now() - DEAD_AFTER).delete()
    # Folders first: one that another process makes meanwhile has its row before.
    folders = list(root().iterdir()) if root().is_dir() else []
    live = {row.folder for row in Export.objects.filter(withdrawn_at=None)}
    for folder in folders:
        if folder.name.lstrip(".") not in live:
            shutil.rmtree(folder, ignore_errors=True)


def root() -> Path:
    """Where exports lie, each in its own folder."""
    return Path(settings.FRONTRUNNER_VAR) / "exports"


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
    export = Export.objects.create(started_at=timezone.now(), touched_at=timezone.now())
    erased = Tombstone.objects.count()
    draft, final = root() / f".{export.folder}", root() / export.folder
    try:
        draft.mkdir(parents=True)
        export.files = _write(export, draft)
        os.replace(draft, final)
        _publish(export, erased)
    except BaseException:
        for folder in (draft, final):
            shutil.rmtree(folder, ignore_errors=True)
        export.delete()
        raise
    return export


def _publish(export: Export, erased: int) -> None:
    """Make EXPORT count, unless more was erased by now than the ERASED when it began."""
    with transaction.atomic():
        export.published_at = timezone.now()
        # An erasure that is not committed yet holds this row, and has withdrawn it once it lets go.
        rows = Export.objects.filter(pk=export.pk, withdrawn_at=None)
        kept = rows.update(published_at=export.published_at, files=export.files)
        if not kept or Tombstone.objects.count() != erased:
            raise ErasedMeanwhileError


def _write(export: Export, folder: Path) -> list[dict[str, Any]]:
    """The export's files in FOLDER; what each holds."""
    # Arrow takes its time to load: only who writes needs it.
    from crowd.results.opendata.files import TableFiles

    scope = Scope.now()
    files = []
    for table in TABLES:
        with TableFiles(table, folder) as target:
            for part in READERS[table.name](scope):
                _touch(export)
                target.write(part)
        files.append(_described(target.parquet, table.name, "parquet", target.rows))
        files.append(_described(target.csv, table.name, "csv", target.rows))
    package = folder / "datapackage.json"
    description = data_package(export.name, export.started_at.isoformat(timespec="seconds"), files)
    package.write_text(json.dumps(description, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    licence = folder / "LICENCE.txt"
    licence.write_text(LICENCE_TEXT.format(**LICENCE))
    files += [_described(package, None, "json"), _described(licence, None, "text")]
    sums = folder / "SHA256SUMS"
    sums.write_text("".join(f"{file['sha256']}  {file['name']}\n" for file in files))
    return [*files, _described(sums, None, "text")]


def _touch(export: Export) -> None:
    rows = Export.objects.filter(pk=export.pk, withdrawn_at=None)
    if not rows.update(touched_at=timezone.now()):
        raise ErasedMeanwhileError


def _described(path: Path, table: str | None, format: str, rows: int | None = None) -> dict[str, Any]:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {
        "name": path.name,
        "table": table,
        "format": format,
        "rows": rows,
        "bytes": path.stat().st_size,
        "sha256": digest,
    }


def _end_surplus() -> None:
    kept = published().values_list("pk", flat=True)[: settings.FRONTRUNNER_EXPORTS_KEPT]
    published().exclude(pk__in=list(kept)).delete()
