"""The files of the open data, named by their content, which exports share, and their lock."""

import hashlib
from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from django.conf import settings
from django.core.files.storage import storages

from crowd.database import locks
from crowd.results.models import ExportFile, StoredFile

if TYPE_CHECKING:
    from django.core.files import File

    from crowd.files.bucket import Bucket
    from crowd.files.folder import Folder

DIGEST_LETTERS = 32  # of a file's digest, in its name


def storage() -> "Folder | Bucket":
    """Where the files of all exports are."""
    return storages["exports"]  # type: ignore[return-value]  # as the settings name them


def drafts() -> Path:
    """The folder of this machine in which files are written before `storage` takes them."""
    folder = Path(settings.FRONTRUNNER_VAR) / "exports"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def open_stored(stored: StoredFile) -> "File[bytes]":
    """The content of `stored`. Raises FileNotFoundError without it, OSError if a bucket does not answer."""
    return storage().open(stored.stored_as)


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


def share(new: StoredFile) -> StoredFile:
    """The row of a file with the content of `new`, which `storage` has: an earlier export's, or `new`, saved.

    The caller holds the lock.
    """
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
        storage().delete(name)


def exports_lock(seconds: float) -> AbstractContextManager[bool]:
    """Lock the files of published exports, as `locks.lock` does."""
    return locks.lock("exports", seconds)
