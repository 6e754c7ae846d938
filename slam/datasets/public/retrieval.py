"""The command `datasets get`: a public sequence on this disk, ready to be run."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from urllib.parse import urlsplit

from groundwork.terminal import progress_line
from slam.datasets import open_sequence
from slam.datasets.public.archive import unpack
from slam.datasets.public.catalogue import ENTRIES, Entry, find
from slam.datasets.public.download import Fetched, fetch
from slam.datasets.sequence import SequenceError

_CHECKED = {
    "published": "its SHA-256 is the published one",
    "recorded": "its SHA-256 is the one recorded at an earlier download",
    "nothing": "its publisher gives no checksum, so its SHA-256 was computed and recorded: a later "
    "download is compared with this one",
}


def register(parser: argparse.ArgumentParser) -> None:
    """Give `get` its arguments."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="without it: those that are known")
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="default: here")
    parser.add_argument("--address", metavar="URL", help="of a copy elsewhere, instead of the publisher's")
    parser.add_argument("--sha256", metavar="DIGEST", help="that the archive must have")
    parser.add_argument("--keep-archive", action="store_true", help="do not delete it once unpacked")
    parser.set_defaults(execute=_get)


def _get(options: argparse.Namespace) -> None:
    if options.name is None:
        for entry in ENTRIES.values():
            size = f"{entry.size / 1e6:.0f} MB" if entry.size else "size not known"
            sys.stdout.write(f"{entry.name:18} {size:>14}  {entry.licence}  {entry.address}\n")
        return
    entry = find(options.name)
    address = options.address or entry.address
    folder = options.out / entry.name
    if folder.exists():
        raise SequenceError(f"{folder} exists already: remove it to fetch {entry.name} again")
    sys.stdout.write(f"{entry.name}: {entry.licence}; cite {entry.citation}; {entry.page}\n")
    name = Path(urlsplit(address).path).name
    if not name:
        raise SequenceError(f"--address {address}: it names no file")
    archive = options.out / name
    fetched = fetch(address, archive, options.sha256 or entry.sha256, progress_line(unit="MB", scale=10**6))
    sys.stdout.write(f"{archive.name}: SHA-256 {fetched.sha256}; {_CHECKED[fetched.checked]}\n")
    unpack(archive, folder)
    _describe(folder, entry, address, fetched)
    if not options.keep_archive:
        archive.unlink()
    sequence = open_sequence(folder)
    truth = "with truth" if sequence.truth is not None else "without truth"
    sys.stdout.write(f"{folder}: {len(sequence)} frames, {truth}\n")


def _describe(folder: Path, entry: Entry, address: str, fetched: Fetched) -> None:
    """Add the camera, where the files lack it, and their origin."""
    camera = entry.camera
    if camera is not None and not (folder / "intrinsics.txt").exists():
        (folder / "intrinsics.txt").write_text(
            f"{camera.fx!r} {camera.fy!r} {camera.cx!r} {camera.cy!r} {camera.width} {camera.height} "
            f"{entry.depth_units:g}\n",
            encoding="utf-8",
        )
    (folder / "SOURCE.txt").write_text(
        f"{address}\nsha256 {fetched.sha256}\n{entry.page}\n"
        f"licence: {entry.licence}\ncite: {entry.citation}\n",
        encoding="utf-8",
    )
