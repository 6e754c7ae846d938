"""The packs that clients download: folders of content-addressed chunks, shipped or installed.

The colour of a sequence is a second pack beside that of its depth, read only if colour is needed.
"""

import hashlib
import json
import logging
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

from django.conf import settings

from crowd.fronts import fetching
from slam.datasets.formats.pack import MANIFEST, Pack, colour_folder
from slam.datasets.sequence import SequenceError as DamagedError

DIGEST = re.compile(r"[0-9a-f]{64}")

log = logging.getLogger(__name__)


class SequenceError(ValueError):
    """A sequence is missing or damaged; the message names it, the folders searched and the remedy."""


def packs() -> Iterator[Path]:
    """All depth packs in the configured folders, then those that are copied from the bucket now.

    Who finds a pack among the first ones asks nothing of the bucket.
    """
    yield from _depth_packs()
    if copied := fetching.fetch():
        yield from (pack for pack in _depth_packs() if pack in copied)


def read_description(pack: Path, colour: bool = False) -> dict[str, Any]:
    """The content of pack.json in the folder `pack`; with `colour`, `colour` is that of the colour pack.

    Raises SequenceError if there is no colour pack.
    """
    description: dict[str, Any] = json.loads((pack / MANIFEST).read_text())
    if not colour:
        return description
    try:
        beside = Pack(pack).colour_manifest
    except DamagedError as error:
        raise SequenceError(str(error)) from error
    if beside is None:
        raise SequenceError(
            f"{description['name']} in {pack} has no colour, which is needed: put the colour pack "
            f"into {colour_folder(pack)}"
        )
    return description | {"colour": beside}


def find_verified(name: str, sha256: str, colour: bool = False) -> dict[str, Any]:
    """The description of the sequence `name` with the digest SHA256, after checking all its chunks.

    Raises SequenceError if the pack, its colour (with `colour`) or a chunk is missing or damaged.
    """
    others = []
    for pack in packs():
        description = read_description(pack)
        if description["name"] == name and description["sha256"] == sha256:
            _verify(pack, description)
            if colour:
                description = read_description(pack, colour)
                _verify(colour_folder(pack), description["colour"])
            return description
        others.append(f"{description['name']} {description['sha256'][:12]}")
    looked = ", ".join(str(folder) for folder in settings.FRONTRUNNER_SEQUENCES)
    raise SequenceError(
        f"no pack {name} with digest {sha256[:12]}... in {looked} (found: {', '.join(others) or 'none'}): "
        "put the pack there, or publish a front that was measured on one of these"
    )


def _verify(pack: Path, description: dict[str, Any]) -> None:
    for chunk in description["chunks"]:
        path = pack / "chunks" / chunk["sha256"]
        try:
            content = path.read_bytes()
        except OSError as error:
            raise SequenceError(f"{path} cannot be read ({error.strerror}): copy the pack again") from error
        if len(content) != chunk["bytes"] or hashlib.sha256(content).hexdigest() != chunk["sha256"]:
            raise SequenceError(f"{path} does not match its digest: copy the pack again")


@lru_cache(maxsize=8)
def open_pack(sha256: str) -> Pack:
    """The pack of the sequence with the digest SHA256. Raises SequenceError without one that can be read."""
    for folder in packs():
        try:
            if read_description(folder)["sha256"] == sha256:
                return Pack(folder)
        except (DamagedError, OSError, ValueError, KeyError) as error:
            log.warning("the pack %s cannot be read: %s", folder, error)
    raise SequenceError(
        f"no complete pack with digest {sha256}: put it into a folder of FRONTRUNNER_SEQUENCES"
    )


def open_chunk(sha256: str) -> IO[bytes] | None:
    """The chunk with the digest SHA256, or None."""
    if not DIGEST.fullmatch(sha256):
        return None
    for pack in _folders():
        path = pack / "chunks" / sha256
        if path.is_file():
            return path.open("rb")
    return fetching.open_chunk(sha256)


def _depth_packs() -> list[Path]:
    folders = list(_folders())
    colours = {colour_folder(folder) for folder in folders}
    return [folder for folder in folders if folder.resolve() not in colours]


def _folders() -> Iterator[Path]:
    for folder in settings.FRONTRUNNER_SEQUENCES:
        for description in sorted(Path(folder).glob(f"*/{MANIFEST}")):
            yield description.parent
