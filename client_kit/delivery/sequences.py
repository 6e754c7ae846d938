"""The clients' sequence: downloaded once, chunk by chunk, each checked by its digest."""

import json
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from client_kit.delivery import downloads
from client_kit.delivery.manifest import Chunk
from client_kit.delivery.server import Server
from client_kit.home import Home, write_file
from slam.datasets.formats.pack import MANIFEST, colour_folder


class Download(Protocol):
    """An object with a sequence and its chunks: a manifest, or a lease."""

    @property
    def sequence(self) -> Mapping[str, Any]: ...

    @property
    def chunks(self) -> tuple[Chunk, ...]: ...

    @property
    def colour(self) -> tuple[Chunk, ...]: ...


class _Pack(NamedTuple):
    """A folder with its chunks, and the content of its pack.json."""

    folder: Path
    chunks: tuple[Chunk, ...]
    description: bytes


def fetch(
    server: Server,
    manifest: Download,
    home: Home,
    progress: Callable[[int, int], None] | None = None,
    pause: Callable[[float], None] = time.sleep,
) -> Path:
    """The folder of the manifest's sequence as a pack, complete and checked.

    Chunks of an interrupted download are reused. `progress` is called with the bytes present and in total.
    Raises HomeError (a full disk), and what `downloads.fetch` raises.
    """
    packs, total = _packs(manifest, home), size(manifest)
    done = 0
    for pack in packs:
        for chunk in pack.chunks:
            path = pack.folder / "chunks" / chunk.sha256
            if not downloads.matches_digest(path, chunk.sha256):
                write_file(path, downloads.fetch(server, chunk.url, chunk.sha256, chunk.bytes, pause))
            done += chunk.bytes
            if progress is not None:
                progress(done, total)
    # Written last: a folder with it is a complete pack.
    for pack in packs:
        write_file(pack.folder / MANIFEST, pack.description)
    return packs[-1].folder


def find_complete(manifest: Download, home: Home) -> Path | None:
    """The folder of the manifest's sequence if it was downloaded completely before, else None."""
    packs = _packs(manifest, home)
    whole = all(
        os.access(pack.folder / MANIFEST, os.R_OK)
        and all(
            downloads.matches_digest(pack.folder / "chunks" / chunk.sha256, chunk.sha256)
            for chunk in pack.chunks
        )
        for pack in packs
    )
    return packs[-1].folder if whole else None


def size(manifest: Download) -> int:
    """The bytes of the sequence, including its colour where required."""
    return sum(chunk.bytes for chunk in (*manifest.chunks, *manifest.colour))


def _packs(manifest: Download, home: Home) -> list[_Pack]:
    """The folders of the sequence, existing or not: depth last."""
    sequence = manifest.sequence
    folder = home.sequence(str(sequence["sha256"]))
    packs = [_Pack(folder, manifest.chunks, _description(sequence))]
    if manifest.colour:
        beside = _description({**sequence, **sequence["colour"]})
        packs.insert(0, _Pack(colour_folder(folder), manifest.colour, beside))
    return packs


def _description(pack: Mapping[str, Any]) -> bytes:
    chunks = [{key: value for key, value in chunk.items() if key != "url"} for chunk in pack["chunks"]]
    kept = {key: value for key, value in pack.items() if key != "colour"}
    return json.dumps({**kept, "chunks": chunks}, indent=1).encode()
