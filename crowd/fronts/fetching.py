"""Sequences of the bucket: copies in the data folder, checked by digest, for programs that need a folder."""

import hashlib
import logging
import re
import tempfile
from pathlib import Path
from typing import IO

from django.conf import settings
from django.core.files.storage import Storage, storages

from slam.datasets.formats.pack import MANIFEST, read_manifest
from slam.datasets.sequence import SequenceError

NAME = re.compile(r"[A-Za-z0-9][\w.-]*")

log = logging.getLogger(__name__)


def fetch() -> list[Path]:
    """Copy the sequences that are new in the bucket, if there is one. Returns their folders.

    What cannot be copied goes to the log, and those that are here are used meanwhile.
    """
    if (bucket := _bucket()) is None:
        return []
    copies = Path(settings.FRONTRUNNER_VAR) / "fetched"
    copies.mkdir(exist_ok=True)
    try:
        names, _ = bucket.listdir("")
    except OSError as error:
        log.warning("the sequences of the bucket cannot be listed: %s", error)
        return []
    copied = []
    for name in filter(NAME.fullmatch, names):
        try:
            if _fetch(bucket, name, copies):
                copied.append(copies / name)
        except (OSError, SequenceError) as error:
            log.warning("the sequence %s of the bucket cannot be copied: %s", name, error)
    return copied


def open_chunk(sha256: str) -> IO[bytes] | None:
    """The chunk with the digest SHA256 in the bucket, or None."""
    if (bucket := _bucket()) is None:
        return None
    names, _ = bucket.listdir("")
    for name in names:
        if bucket.exists(chunk := f"{name}/chunks/{sha256}"):
            return bucket.open(chunk)
    return None


def _bucket() -> Storage | None:
    return storages["sequences"] if "sequences" in settings.STORAGES else None


def _fetch(bucket: Storage, name: str, copies: Path) -> bool:
    """Copy the pack `name`, unless its copy has the same pack.json. Returns whether it was copied.

    Raises SequenceError for a damaged pack.
    """
    manifest = _read(bucket, f"{name}/{MANIFEST}")
    copy = copies / name
    if _manifest(copy) == manifest:
        return False
    with tempfile.TemporaryDirectory(prefix=".", dir=copies) as folder:
        new = Path(folder) / "new"
        (new / "chunks").mkdir(parents=True)
        (new / MANIFEST).write_bytes(manifest)
        for digest in (chunk["sha256"] for chunk in read_manifest(new)["chunks"]):
            content = _read(bucket, f"{name}/chunks/{digest}")
            if hashlib.sha256(content).hexdigest() != digest:
                raise SequenceError(f"chunk {digest} does not match its digest: copy it there again")
            (new / "chunks" / digest).write_bytes(content)
        if _manifest(copy) == manifest:  # another process was faster, and may read it
            return True
        if copy.exists():
            copy.rename(Path(folder) / "earlier")
        new.rename(copy)
    return True


def _manifest(copy: Path) -> bytes | None:
    return (copy / MANIFEST).read_bytes() if (copy / MANIFEST).is_file() else None


def _read(bucket: Storage, name: str) -> bytes:
    with bucket.open(name) as file:
        return bytes(file.read())
