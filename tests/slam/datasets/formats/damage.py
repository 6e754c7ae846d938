"""Ways in which files of sequences are damaged, each chosen by a seeded generator."""

from __future__ import annotations

import hashlib
import json
import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

TOKENS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "1e400", "0", "-0", "-1", "1.5", "640.5", "1e13",
    "x", "0x10", "1_0", "9" * 30, "9" * 5000, "\0", "\u00b2", "\u0663", "depth", "../x.png", "/", ".", "#",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 1.5, 1e308, -1e308, float("nan"), float("inf"), 2**31, 2**63, 10**400, "x",
    "", "\0", [], {}, [1, 2, 3], [float("nan")] * 3, ["x"], {"a": 1}, [[0.0] * 12], [[0.0] * 12] * 4,
)  # fmt: skip
WHOLE_WORDS = (0, 1, 2**31, 2**32 - 1, 16384, 16385)
REAL_WORDS = (float("nan"), float("inf"), -1.0, 3e38, 1e-38, 0.0)
WORDS = (
    *(struct.pack("<I", value) for value in WHOLE_WORDS),
    *(struct.pack("<f", value) for value in REAL_WORDS),
)
PNG_HEADER = 8


def damage_text(data: bytes, rng: random.Random) -> bytes:
    """`data`, which is text, with a token, a line or its encoding changed; or damaged as binary data is."""
    text = data.decode("utf-8")
    lines = text.splitlines() or [""]
    row = rng.randrange(len(lines))
    kind = rng.randrange(9)
    if kind <= 3:
        items = lines[row].split(" ")
        items[rng.randrange(len(items))] = rng.choice(TOKENS)
        lines[row] = " ".join(items)
    elif kind == 4:
        del lines[row]
    elif kind == 5:
        lines.insert(rng.randrange(len(lines) + 1), lines[row])
    elif kind == 6:
        # As Windows PowerShell writes files, as some editors do, and text of another language.
        return text.encode(
            rng.choice(("utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "utf-32"))
        ) + rng.choice((b"", b"\xe4"))
    elif kind == 7:
        return ("\r\n" if rng.random() < 0.5 else "\r").join(lines).encode()
    else:
        return damage_bytes(data, rng)
    return "\n".join(lines).encode()


def damage_bytes(data: bytes, rng: random.Random, first: int | None = None) -> bytes:
    """`data` with bytes changed, cut off or added; most changes lie in the `first` bytes, where headers
    are."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 4))):
        most = len(changed) if first is None or rng.random() < 0.3 else min(first, len(changed))
        position = rng.randrange(most) if most else 0
        kind = rng.randrange(6)
        if kind == 0:
            changed[position : position + 1] = bytes([rng.randrange(256)])
        elif kind <= 2:
            changed[position : position + 4] = rng.choice(WORDS)
        elif kind == 3:
            del changed[position:]
        elif kind == 4:
            changed[position:position] = rng.randbytes(rng.choice((1, 4, 100)))
        else:
            changed[position : position + 64] = bytes(64)
    return bytes(changed)


def damage_png(data: bytes, rng: random.Random) -> bytes:
    """A PNG of which a part is damaged, most often with a checksum that fits all the same."""
    if rng.random() < 0.3:
        return damage_bytes(data, rng)
    parts, position = [], PNG_HEADER
    while position < len(data):
        (length,) = struct.unpack_from(">I", data, position)
        parts.append((data[position + 4 : position + 8], data[position + 8 : position + 8 + length]))
        position += 12 + length
    chosen = rng.randrange(len(parts))
    name, content = parts[chosen]
    parts[chosen] = (name, damage_bytes(content, rng) if content else rng.randbytes(8))
    damaged = data[:PNG_HEADER]
    for name, content in parts:
        checksum = zlib.crc32(name + content)
        damaged += struct.pack(">I", len(content)) + name + content + struct.pack(">I", checksum)
    return damaged


def damage_json(document: Any, rng: random.Random) -> Any:
    """`document` with one of its values, or a value inside that, replaced or left out."""
    if isinstance(document, dict | list) and document and rng.random() < 0.8:
        key = rng.choice(list(document)) if isinstance(document, dict) else rng.randrange(len(document))
        changed = document.copy()
        if rng.random() < 0.15:
            del changed[key]
        else:
            changed[key] = damage_json(document[key], rng)
        return changed
    return rng.choice(VALUES)


def damage_pack(folder: Path, rng: random.Random) -> None:
    """Damage a pack: its manifest, or its header or a chunk with digests that fit all the same."""
    path = folder / "pack.json"
    manifest = json.loads(path.read_text())
    kind = rng.randrange(5)
    if kind == 0:
        path.write_bytes(damage_text(path.read_bytes(), rng))
        return
    if kind == 1:
        path.write_text(json.dumps(damage_json(manifest, rng)))
        return
    number = 0 if kind <= 3 else rng.randrange(len(manifest["chunks"]))
    chunk = (folder / "chunks" / manifest["chunks"][number]["sha256"]).read_bytes()
    if kind <= 3:
        header = damage_json(json.loads(zlib.decompress(chunk)), rng)
        chunk = zlib.compress(json.dumps(header).encode())
        if isinstance(header, dict):
            manifest |= {
                key: header[key] for key in manifest if key in header and key not in ("sha256", "chunks")
            }
    else:
        chunk = damage_bytes(chunk, rng, first=600)
    name = hashlib.sha256(chunk).hexdigest()
    (folder / "chunks" / name).write_bytes(chunk)
    manifest["chunks"][number] = {"sha256": name, "bytes": len(chunk)}
    names = "".join(entry["sha256"] + "\n" for entry in manifest["chunks"])
    manifest["sha256"] = hashlib.sha256(names.encode()).hexdigest()
    path.write_text(json.dumps(manifest))


def of_kind(path: Path) -> Callable[[bytes, random.Random], bytes]:
    """How a file of this name is damaged."""
    if path.suffix == ".png":
        return damage_png
    if path.suffix == ".raw":
        return lambda data, rng: damage_bytes(data, rng, first=16)
    if path.suffix == ".slam":
        return lambda data, rng: damage_bytes(data, rng, first=500)
    return damage_text
