"""Unpack an untrusted archive into a folder that appears only when it is complete."""

from __future__ import annotations

import gzip
import lzma
import os
import shutil
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from slam.datasets.sequence import SequenceError

DAMAGE = (
    tarfile.TarError,
    zipfile.BadZipFile,
    gzip.BadGzipFile,
    lzma.LZMAError,
    zlib.error,
    EOFError,
)


class ArchiveError(SequenceError):
    """An archive that is damaged or that would write outside its folder."""


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a tar (of any compression) or zip archive into `folder`, which must not exist.

    A single folder at the archive's top becomes `folder` itself. Only plain files and folders are taken.
    Raises ArchiveError, and leaves nothing behind, for absolute names, names with `..`, links, devices and
    damaged archives.
    """
    if folder.exists():
        raise ArchiveError(f"{folder} exists already: remove it or choose another folder")
    partial = folder.with_name(folder.name + ".partial")
    if partial.exists():
        shutil.rmtree(partial)
    partial.mkdir(parents=True)
    try:
        members = _zipped(archive) if zipfile.is_zipfile(archive) else _tarred(archive)
        for name, content in members:
            _place(partial, name, content, archive)
        inside = list(partial.iterdir())
        if not inside:
            raise ArchiveError(f"{archive} holds no file")
        single = len(inside) == 1 and inside[0].is_dir() and inside[0].name not in ("depth", "rgb")
        os.replace(inside[0] if single else partial, folder)
    except DAMAGE as error:
        raise ArchiveError(f"{archive} is damaged or no archive ({error}): fetch it again") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _tarred(archive: Path) -> Iterator[tuple[str, IO[bytes] | None]]:
    """Names and contents, None for a folder."""
    with tarfile.open(archive) as tar:
        for member in tar:
            if not (member.isfile() or member.isdir()):
                raise ArchiveError(f"{archive}: {member.name!r} is a link or a device, which is not unpacked")
            yield member.name, None if member.isdir() else tar.extractfile(member)
        # A tar's last member is not the end of the compressed file, whose checksum comes last.
        while tar.fileobj and tar.fileobj.read(1 << 20):
            pass


def _zipped(archive: Path) -> Iterator[tuple[str, IO[bytes] | None]]:
    with zipfile.ZipFile(archive) as zipped:
        for member in zipped.infolist():
            kind = stat.S_IFMT(member.external_attr >> 16)
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR) or member.flag_bits & 1:
                raise ArchiveError(
                    f"{archive}: {member.filename!r} is a link, a device or encrypted, which is not unpacked"
                )
            if member.is_dir():
                yield member.filename, None
            else:
                with zipped.open(member) as content:
                    yield member.filename, content


def _place(folder: Path, name: str, content: IO[bytes] | None, archive: Path) -> None:
    path = PurePosixPath(name)
    # Backslashes and colons are separators and drives elsewhere.
    if path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name or "\0" in name:
        raise ArchiveError(f"{archive}: {name!r} would be written outside its folder: do not trust it")
    target = folder.joinpath(*path.parts)
    if content is None:
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("wb") as file:
        shutil.copyfileobj(content, file, 1 << 20)
