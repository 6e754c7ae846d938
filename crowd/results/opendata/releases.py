"""Addresses of exports: which has a day's, which `latest`, which stays as a release."""

from datetime import date

from django.conf import settings
from django.db import transaction
from django.db.models import QuerySet
from django.utils import timezone

from crowd.audit.services import record
from crowd.http.problems import Problem, not_found
from crowd.results.models import Export, ExportFile
from crowd.results.models.exports import LATEST

PREPARATION_SECONDS = 300


class ReleaseError(Exception):
    """An export cannot become a release; the message gives the reason."""


def published_exports() -> QuerySet[Export]:
    """The exports that are served, newest first."""
    return Export.objects.exclude(published_at=None).filter(removed_at=None)


def releases() -> QuerySet[Export]:
    """The releases, newest first."""
    return published_exports().filter(release=True)


def latest() -> Export | None:
    """The export behind /data/latest/."""
    return published_exports().first()


def newest_day() -> Export:
    """The newest export with an address of its own. Raises ReleaseError without one."""
    export = published_exports().exclude(day=None).first()
    if export is None:
        raise ReleaseError("there is no export yet: write one with `results export`")
    return export


def listed_exports() -> list[Export]:
    """The exports of all addresses, newest first, with their files: one a day, and the latest."""
    rows = list(published_exports().prefetch_related("files"))
    return [row for index, row in enumerate(rows) if index == 0 or row.day is not None]


def give_address(export: Export) -> None:
    """Give `export` the address of its day, unless another one has it. The caller saves it.

    The first one of a month that has runs is a release.
    """
    day = export.started_at.date()
    if Export.objects.filter(day=day).exclude(pk=export.pk).exists():
        return
    export.day = day
    of_month = releases().filter(day__year=day.year, day__month=day.month)
    export.release = export.last_run > 0 and not of_month.exists()


@transaction.atomic
def make_release(export: Export, actor: str) -> None:
    """Make `export` a release, in the name of `actor`. Raises ReleaseError."""
    row = Export.objects.select_for_update().get(pk=export.pk)
    if row.release:
        raise ReleaseError(f"{row.name} is a release already")
    if row.day is None:
        day = row.started_at.date()
        raise ReleaseError(
            f"/data/{day}/ is an earlier export of {day}: make that one a release, or wait for tomorrow's"
        )
    if row.published_at is None or row.removed_at is not None:
        raise ReleaseError(f"{row.name} has no files: choose one that /data/ lists")
    row.release = True
    row.save(update_fields=["release"])
    record(actor, "make release", f"open data of {row.name}")


def remove_surplus() -> None:
    """Remove exports that no address needs: others than releases and the newest ones of a day each."""
    newest = latest()
    others = published_exports().filter(release=False)
    others = others.exclude(pk=newest.pk) if newest else others
    others.filter(day=None).delete()
    kept = published_exports().filter(release=False).exclude(day=None)
    surplus = list(kept.values_list("pk", flat=True)[settings.FRONTRUNNER_EXPORTS_KEPT :])
    ExportFile.objects.filter(export__in=surplus).delete()
    Export.objects.filter(pk__in=surplus).update(removed_at=timezone.now())


def find_export(name: str) -> Export:
    """The export with the address /data/NAME/.

    Raises Problem: 404 not_found, 410 export_removed, 503 export_in_preparation.
    """
    if name == LATEST:
        if (newest := latest()) is None:
            detail = "the first export is being written"
            raise Problem("export_in_preparation", detail, retry_after=PREPARATION_SECONDS)
        return newest
    day = _day(name)
    export = Export.objects.filter(day=day).first() if day else None
    if export is None:
        raise not_found(f"no export {name!r}: GET /api/v1/exports lists them")
    if export.removed_at is not None:
        raise Problem("export_removed", _removed(export))
    return export


def _removed(export: Export) -> str:
    """What a reader of the removed `export` can use instead."""
    release = releases().filter(started_at__gte=export.started_at).last()
    if release is not None:
        return f"only releases are kept: /data/{release.name}/ contains the data of {export.name}"
    return (
        f"only releases are kept: the next one will contain the data of {export.name}, and until then "
        f"/data/{LATEST}/ does"
    )


def _day(name: str) -> date | None:
    """The day that `name` writes as YYYY-MM-DD."""
    try:
        day = date.fromisoformat(name)
    except ValueError:
        return None
    return day if day.isoformat() == name else None
