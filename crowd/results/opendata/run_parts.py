"""The parts of the table of runs, which exports share: a run does not change after it was measured."""

from collections.abc import Iterator

import pyarrow.parquet

from crowd.results.models import ExportFile, Run, StoredFile
from crowd.results.opendata import releases
from crowd.results.opendata.part_writer import schema
from crowd.results.opendata.storing import open_stored, storage
from crowd.results.opendata.tables import RUNS
from crowd.results.opendata.writing import PART_BYTES, SUFFIXES, Part


def shared_parts(last_run: int) -> list[Part]:
    """The newest export's parts that an export of the runs up to `last_run` need not write again.

    Small parts at the end are written again together with at least as many newer runs. So a run is written a
    few times at most, and the number of small parts grows with the logarithm of the number of exports.
    """
    parts = list(_complete_parts())
    newer = Run.objects.filter(pk__gt=covered(parts), pk__lte=last_run).count()
    while parts and 0 < newer >= (rows := _parquet(parts[-1]).rows or 0) and not _is_full(parts[-1]):
        newer += rows
        parts.pop()
    return parts


def covered(parts: list[Part]) -> int:
    """The primary key of the newest run that `parts` cover."""
    return _parquet(parts[-1]).until_run if parts else 0


def _complete_parts() -> Iterator[Part]:
    """The first parts of the newest export, up to one that lacks a run or has other columns.

    A transaction that committed late may add a run between those of an earlier export.
    """
    export = releases.latest()
    rows = export.files.filter(stored__table=RUNS.name).order_by("part", "pk") if export else []
    parts: dict[int, Part] = {}
    for row in rows:
        name = f"{RUNS.name}.{SUFFIXES[row.stored.format]}"
        parts.setdefault(row.part, []).append(ExportFile(stored=row.stored, name=name))
    after = 0
    for part in parts.values():
        stored = _parquet(part)
        stored_now = Run.objects.filter(pk__gt=after, pk__lte=stored.until_run).count()
        if not (stored.stale or stored.rows == stored_now) or not _is_usable(part):
            return
        yield part
        after = stored.until_run


def _parquet(part: Part) -> StoredFile:
    return next(file.stored for file in part if file.stored.format == "parquet")


def _is_full(part: Part) -> bool:
    """Whether `part` is large enough to stay. Erasures make it a little smaller than when it was written."""
    return _parquet(part).bytes > PART_BYTES // 2


def _is_usable(part: Part) -> bool:
    """Whether the files of `part` are there, with the columns of this version."""
    if not all(storage().exists(file.stored.stored_as) for file in part):
        return False
    with open_stored(_parquet(part)) as file:
        return bool(pyarrow.parquet.read_schema(file).equals(schema(RUNS)))
