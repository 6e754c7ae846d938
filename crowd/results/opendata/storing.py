"""The folder of the open data: files named by their content, which exports share, and its lock."""

import fcntl
import hashlib
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from django.conf import settings

from crowd.results.models import ExportFile, StoredFile

LOCK_POLL_SECONDS = 0.05
DIGEST_LETTERS = 32  # of a file's digest, in its name


def exports_folder() -> Path:
    """The folder of all files of the open data."""
    return Path(settings.FRONTRUNNER_VAR) / "exports"


def path_of(stored: StoredFile) -> Path:
    """Where the content of `stored` is."""
    return exports_folder() / stored.stored_as


def describe(path: Path, name: str, table: str, format: str) -> ExportFile:
    """The unsaved row of the file at `path`, which is renamed after its content, in its folder."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    _, dot, suffix = name.partition(".")
    stored = StoredFile(
        table=table,
        format=format,
        stored_as=f"{table}-{digest[:DIGEST_LETTERS]}{dot}{suffix}",
        bytes=path.stat().st_size,
        sha256=digest,
    )
    path.replace(path.with_name(stored.stored_as))
    return ExportFile(stored=stored, name=name)


def share(new: StoredFile, folder: Path) -> StoredFile:
    """The row of a file with the content of `new`: an earlier export's, or `new`, saved.

    Moves the content from `folder` into that of all files. The caller holds the lock.
    """
    os.replace(folder / new.stored_as, path_of(new))
    earlier = StoredFile.objects.filter(stored_as=new.stored_as, sha256=new.sha256).first()
    if earlier is not None:
        return earlier
    new.save()
    return new


def delete_unused(names: Iterable[str]) -> None:
    """Delete those of the files `names` that no row needs. The caller holds the lock."""
    candidates = set(names)
    used = set(StoredFile.objects.filter(stored_as__in=candidates).values_list("stored_as", flat=True))
    for name in candidates - used:
        (exports_folder() / name).unlink(missing_ok=True)


@contextmanager
def folder_lock(seconds: float) -> Iterator[bool]:
    """Lock the files of published exports; waits for at most `seconds`. Yields whether the lock is held."""
    end = time.monotonic() + seconds
    exports_folder().mkdir(parents=True, exist_ok=True)
    with exports_folder().with_suffix(".lock").open("w") as file:
        while not (held := _try_lock(file.fileno())) and time.monotonic() < end:
            time.sleep(LOCK_POLL_SECONDS)
        yield held  # closing the file releases the lock


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
