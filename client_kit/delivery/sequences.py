"""The clients' sequence: downloaded once, chunk by chunk, each checked by its digest."""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from client_kit.delivery import downloads
from client_kit.delivery.server import Server
from client_kit.home import Home, write_file
from slam.datasets.formats.pack import MANIFEST, colour_folder
from wire.manifest import Chunk, Sequence


class _Pack(NamedTuple):
    """A folder with its chunks, and the content of its pack.json."""

    folder: Path
    chunks: tuple[Chunk, ...]
    description: bytes


def fetch(
    server: Server,
    sequence: Sequence,
    home: Home,
    progress: Callable[[int, int], None] | None = None,
    pause: Callable[[float], None] = time.sleep,
) -> Path:
    """The folder of `sequence` as a pack, complete and checked.

    Chunks of an interrupted download are reused. `progress` is called with the bytes present and in total.
    Raises HomeError (a full disk), and what `downloads.fetch` raises.
    """
    packs, total = _packs(sequence, home), size(sequence)
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


def find_complete(sequence: Sequence, home: Home) -> Path | None:
    """The folder of `sequence` if it was downloaded completely before, else None."""
    packs = _packs(sequence, home)
    whole = all(
        os.access(pack.folder / MANIFEST, os.R_OK)
        and all(
            downloads.matches_digest(pack.folder / "chunks" / chunk.sha256, chunk.sha256)
            for chunk in pack.chunks
        )
        for pack in packs
    )
    return packs[-1].folder if whole else None


def size(sequence: Sequence) -> int:
    """The bytes of the sequence, including its colour where required."""
    colour = () if sequence.colour is None else sequence.colour.chunks
    return sum(chunk.bytes for chunk in (*sequence.chunks, *colour))


def _packs(sequence: Sequence, home: Home) -> list[_Pack]:
    """The folders of the sequence, existing or not: depth last."""
    folder, colour = home.sequence(sequence.sha256), sequence.colour
    packs = [_Pack(folder, sequence.chunks, _description(sequence))]
    if colour is not None:
        beside = replace(sequence, name=colour.name, sha256=colour.sha256, chunks=colour.chunks)
        packs.insert(0, _Pack(colour_folder(folder), colour.chunks, _description(beside)))
    return packs


def _description(sequence: Sequence) -> bytes:
    """The content of a pack.json."""
    chunks = [{"sha256": chunk.sha256, "bytes": chunk.bytes} for chunk in sequence.chunks]
    kept: dict[str, Any] = msgspec.to_builtins(sequence) | {"chunks": chunks}
    del kept["colour"]
    return json.dumps(kept, indent=1).encode()
