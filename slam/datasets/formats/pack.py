"""Sequence packs: what clients download, check and measure.

A pack is a folder with `pack.json` and `chunks/<sha256>`. `pack.json` names the sequence, its size and start,
and its chunks in order with digest and length; the same object travels in the HTTP manifest. The first chunk
is the header (deflated JSON: camera, stamps, truth), the others hold FRAMES_PER_CHUNK frames each. The pack's
own digest is the SHA-256 of its chunks' hexadecimal digests, a line each, so it covers every byte of content.
The header repeats the scene of `pack.json`, which is therefore covered, too.

Depth is lossless (codec.py). Colour is JPEG in a second pack `<name>-colour` beside the first.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from slam.datasets.formats import codec, images
from slam.datasets.formats.pack_header import (
    DESCRIBED,
    camera_of,
    check_chunks,
    check_description,
    parse_object,
    timestamps_of,
    truth_of,
)
from slam.datasets.sequence import DigestError, Progress, Sequence, SequenceError
from slam.trajectories.text_files import read_text

T = TypeVar("T")

FORMAT = 1
FRAMES_PER_CHUNK = 10
JPEG_QUALITY = 80
MANIFEST = "pack.json"
MAXIMAL_HEADER = 64 * 2**20  # bytes of inflated header: some 200,000 frames


class _Chunks:
    """The verified chunks of one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest = read_manifest(folder)
        self.header = self._read_header()
        self._kept: tuple[int, bytes] | None = None

    def read(self, number: int) -> bytes:
        """Chunk `number`; raises DigestError when its bytes do not match the manifest."""
        entry = self.manifest["chunks"][number]
        path: Path = self.folder / "chunks" / entry["sha256"]
        try:
            data = path.read_bytes()
        except OSError as error:
            raise SequenceError(f"chunk {number} of {self.folder} is missing: {error}") from None
        actual = hashlib.sha256(data).hexdigest()
        if actual != entry["sha256"] or len(data) != entry["bytes"]:
            raise DigestError(
                f"chunk {number} of {self.folder} is damaged: {len(data)} bytes with digest {actual[:12]}"
                f"..., expected {entry['bytes']} with {entry['sha256'][:12]}...: delete {path} and fetch it "
                "again"
            )
        return data

    def of_frame(self, index: int) -> tuple[bytes, int]:
        """The chunk that holds a frame, and the frame's place in it; the last chunk stays in memory."""
        number, position = divmod(index, self.header["frames_per_chunk"])
        if self._kept is None or self._kept[0] != number:
            self._kept = (number, self.read(number + 1))
        return self._kept[1], position

    def _read_header(self) -> dict[str, Any]:
        inflater = zlib.decompressobj()
        try:
            header = parse_object(inflater.decompress(self.read(0), MAXIMAL_HEADER))
        except (zlib.error, ValueError) as error:
            if isinstance(error, SequenceError):
                raise
            raise SequenceError(f"the header of {self.folder} cannot be read: {error}") from None
        if header.get("format") != FORMAT:
            raise SequenceError(f"{self.folder} is not a pack of format {FORMAT}: update this program")
        for key in DESCRIBED:
            if header.get(key) != self.manifest.get(key):
                raise DigestError(
                    f"{self.folder}: {key} is {self.manifest.get(key)!r} in {MANIFEST} and "
                    f"{header.get(key)!r} in the header: fetch the pack again"
                )
        check_chunks(header, len(self.manifest["chunks"]), self.folder)
        return header


class Pack(Sequence):
    """A depth pack, with colour where the colour pack of the same sequence lies beside it.

    Opening checks the manifest and the header; a chunk is checked when a frame of it is first read.
    Raises SequenceError when the folder is not a pack, DigestError when its content does not match its
    digests.
    """

    fixed_size = True

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        folder = Path(folder)
        self._chunks = _Chunks(folder)
        header = self._chunks.header
        if header.get("kind") != "depth":
            raise SequenceError(f"{folder} is a {header.get('kind')} pack: open the depth pack beside it")
        start = header["initial_position"]
        self.name = header["name"]
        self.camera = camera_of(header, folder)
        self.timestamps = timestamps_of(header, folder)
        self.truth = truth_of(header, folder)
        self.volume_size = header["volume_size"]
        self.initial_position = None if start is None else (start[0], start[1], start[2])
        self._colour = self._beside()

    def _beside(self) -> _Chunks | None:
        folder = colour_folder(self._chunks.folder)
        if not (folder / MANIFEST).exists():
            return None
        chunks = _Chunks(folder)
        return chunks if chunks.header.get("depth_sha256") == self.sha256 else None

    @property
    def manifest(self) -> dict[str, Any]:
        """The content of `pack.json`: the HTTP manifest's `sequence` without addresses."""
        return dict(self._chunks.manifest)

    @property
    def colour_manifest(self) -> dict[str, Any] | None:
        """The content of the colour's `pack.json`; None without a colour pack."""
        return None if self._colour is None else dict(self._colour.manifest)

    @property
    def sha256(self) -> str:
        return str(self._chunks.manifest["sha256"])

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        chunk, position = self._chunks.of_frame(index)
        return codec.decode(chunk, position, self.camera.width, self.camera.height)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        if self._colour is None:
            return None
        chunk, position = self._colour.of_frame(index)
        image = images.decode_jpeg(codec.part(chunk, position))
        if image.shape[:2] != (self.camera.height, self.camera.width):
            raise SequenceError(
                f"the colour of frame {index} of {self.name!r} is {image.shape[1]}x{image.shape[0]}, not "
                f"{self.camera.width}x{self.camera.height}: fetch the colour pack again"
            )
        return image

    def verify(self) -> None:
        """Read every chunk once; raises SequenceError or DigestError at the first bad one."""
        for number in range(len(self._chunks.manifest["chunks"])):
            self._chunks.read(number)


def write(sequence: Sequence, folder: str | os.PathLike[str], progress: Progress | None = None) -> Pack:
    """Write the depth of any sequence as a pack and return it opened. `pack.json` appears last.

    Chunks of an earlier pack in the same folder that are not used any more are removed.
    """
    header = _header(sequence, "depth")
    parts = (codec.encode(frames) for frames in _batches(sequence, sequence.depth, progress))
    _write(Path(folder), header, parts)
    return Pack(folder)


def write_colour(sequence: Sequence, beside: Pack, folder: Path, progress: Progress | None = None) -> None:
    """Write the colour of a sequence as the pack that belongs to the depth pack `beside`.

    Raises SequenceError when a frame has no colour.
    """

    def jpeg(index: int) -> bytes:
        colour = sequence.colour(index)
        if colour is None:
            raise SequenceError(f"frame {index} of {sequence.name!r} has no colour")
        return images.encode_jpeg(colour, JPEG_QUALITY)

    header = _header(sequence, "colour") | {"depth_sha256": beside.sha256}
    parts = (codec.join(frames) for frames in _batches(sequence, jpeg, progress))
    _write(folder, header, parts)


def colour_folder(folder: Path) -> Path:
    """The folder of the colour of the depth pack in `folder`, if any."""
    folder = folder.resolve()
    return folder.with_name(folder.name + "-colour")


def digest(chunks: Iterable[dict[str, Any]]) -> str:
    """The digest of a pack with these chunks, `[{"sha256", "bytes"}, ...]` in order."""
    return hashlib.sha256("".join(chunk["sha256"] + "\n" for chunk in chunks).encode()).hexdigest()


def _header(sequence: Sequence, kind: str) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "kind": kind,
        "name": sequence.name,
        "width": sequence.camera.width,
        "height": sequence.camera.height,
        "frames": len(sequence),
        "volume_size": sequence.volume_size,
        "initial_position": list(sequence.initial_position) if sequence.initial_position else None,
        "camera": asdict(sequence.camera),
        "timestamps": sequence.timestamps.tolist(),
        "truth": _rows_from_truth(sequence.truth),
        "frames_per_chunk": FRAMES_PER_CHUNK,
    }


def _batches(sequence: Sequence, read: Callable[[int], T], progress: Progress | None) -> Iterator[list[T]]:
    for begin in range(0, len(sequence), FRAMES_PER_CHUNK):
        batch = []
        for index in range(begin, min(begin + FRAMES_PER_CHUNK, len(sequence))):
            batch.append(read(index))
            if progress:
                progress(index + 1, len(sequence))
        yield batch


def _write(folder: Path, header: dict[str, Any], parts: Iterator[bytes]) -> None:
    (folder / "chunks").mkdir(parents=True, exist_ok=True)
    chunks = [_write_chunk(folder, zlib.compress(json.dumps(header).encode(), 9))]
    chunks += [_write_chunk(folder, part) for part in parts]
    manifest = {key: header[key] for key in DESCRIBED} | {"sha256": digest(chunks), "chunks": chunks}
    partial = folder / (MANIFEST + ".partial")
    partial.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    os.replace(partial, folder / MANIFEST)
    used = {chunk["sha256"] for chunk in chunks}
    for path in (folder / "chunks").iterdir():
        if re.fullmatch(r"[0-9a-f]{64}", path.name) and path.name not in used:
            path.unlink()


def _write_chunk(folder: Path, data: bytes) -> dict[str, Any]:
    name = hashlib.sha256(data).hexdigest()
    (folder / "chunks" / name).write_bytes(data)
    return {"sha256": name, "bytes": len(data)}


def read_manifest(folder: Path) -> dict[str, Any]:
    """The content of `pack.json`. Raises SequenceError or DigestError when it does not describe a pack."""
    path = folder / MANIFEST
    try:
        manifest = parse_object(read_text(path, SequenceError))
    except SequenceError:
        raise
    except ValueError as error:
        raise SequenceError(f"{path} cannot be read: {error}") from None
    chunks = manifest.get("chunks")
    if not isinstance(chunks, list) or not chunks or not all(_is_chunk(chunk) for chunk in chunks):
        raise SequenceError(
            f'{path} is not a pack: "chunks" must list sha256 (64 hexadecimal digits) and bytes'
        )
    if digest(chunks) != manifest.get("sha256"):
        raise DigestError(f"{path}: its sha256 is not the digest of its chunks: fetch the pack again")
    check_description(manifest, path)
    return manifest


def _is_chunk(chunk: Any) -> bool:
    # The digest becomes a file name, so nothing but digits may pass.
    return (
        isinstance(chunk, dict)
        and isinstance(chunk.get("bytes"), int)
        and not isinstance(chunk["bytes"], bool)
        and isinstance(chunk.get("sha256"), str)
        and re.fullmatch(r"[0-9a-f]{64}", chunk["sha256"]) is not None
    )


def _rows_from_truth(truth: npt.NDArray[np.float64] | None) -> list[list[float] | None] | None:
    """The upper three rows of each pose, None for a pose that is not known (JSON has no NaN)."""
    if truth is None:
        return None
    return [pose[:3].ravel().tolist() if np.isfinite(pose).all() else None for pose in truth]
