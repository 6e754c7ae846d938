"""Sequences of the bucket: copies in the data folder, checked by digest, for programs that need a folder."""

import hashlib
import json
import logging
import shutil
import tempfile
from pathlib import Path
from typing import IO, Any

from django.conf import settings
from django.core.files.storage import Storage, storages

from slam.datasets.formats.pack import MANIFEST

log = logging.getLogger(__name__)


def fetch() -> None:
    """Copy the sequences that are new in the bucket, if there is one.

    What cannot be copied goes to the log, and those that are here are used meanwhile.
    """
    if (bucket := _bucket()) is None:
        return
    copies = Path(settings.FRONTRUNNER_VAR) / "fetched"
    copies.mkdir(exist_ok=True)
    try:
        names, _ = bucket.listdir("")
    except OSError as error:
        log.warning("the sequences of the bucket cannot be listed: %s", error)
        return
    for name in names:
        try:
            _fetch(bucket, name, copies)
        except (OSError, ValueError, KeyError) as error:
            log.warning("the sequence %s of the bucket cannot be copied: %r", name, error)


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


def _fetch(bucket: Storage, name: str, copies: Path) -> None:
    """Copy the pack `name`, unless its copy has the same pack.json. Raises ValueError for a damaged one."""
    manifest = _read(bucket, f"{name}/{MANIFEST}")
    copy = copies / name
    if (copy / MANIFEST).is_file() and (copy / MANIFEST).read_bytes() == manifest:
        return
    description: dict[str, Any] = json.loads(manifest)
    with tempfile.TemporaryDirectory(prefix=".", dir=copies) as folder:
        new = Path(folder) / name
        (new / "chunks").mkdir(parents=True)
        for chunk in description["chunks"]:
            content = _read(bucket, f"{name}/chunks/{chunk['sha256']}")
            if hashlib.sha256(content).hexdigest() != chunk["sha256"]:
                raise ValueError(f"chunk {chunk['sha256']} does not match its digest: copy it there again")
            (new / "chunks" / chunk["sha256"]).write_bytes(content)
        (new / MANIFEST).write_bytes(manifest)
        shutil.rmtree(copy, ignore_errors=True)
        new.rename(copy)


def _read(bucket: Storage, name: str) -> bytes:
    with bucket.open(name) as file:
        return bytes(file.read())
