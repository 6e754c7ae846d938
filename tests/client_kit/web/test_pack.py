"""The pack's codec in JavaScript gives what Python's gives, and refuses what is damaged."""

from __future__ import annotations

import hashlib
import json
import zlib
from typing import Any

import numpy as np
import pytest

from slam.datasets import open_sequence
from slam.datasets.formats import codec
from tests.client_kit.web.orders import chunk_addresses
from tests.shipped import LIVING_ROOM

DIGESTS = """async (paths) => {
    const { readHeader, readFrames } = await import("/measure/pack.js");
    const fetched = (path) => fetch(path).then((answer) => answer.arrayBuffer());
    const [first, ...chunks] = await Promise.all(paths.map(fetched));
    const header = await readHeader(first);
    const digests = [];
    for (const frame of await readFrames(header, chunks, header.frames)) {
        const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", frame));
        digests.push(Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join(""));
    }
    return { header, digests };
}"""
READ = """async ({ name, data, parameters }) => {
    const pack = await import("/measure/pack.js");
    try {
        const found = await pack[name](Uint8Array.from(data).buffer, ...parameters);
        return Array.from(found);
    } catch (error) {
        return `${error.constructor.name}: ${error.message}`;
    }
}"""


@pytest.mark.slow
def test_every_frame_of_the_shipped_sequence_is_what_python_decodes(web_page: Any, web_server: Any) -> None:
    web_server.folders["/living-room/"] = LIVING_ROOM
    sequence = open_sequence(LIVING_ROOM)

    found = web_page.evaluate(DIGESTS, chunk_addresses(LIVING_ROOM, "/living-room/"))

    assert found["digests"] == [
        hashlib.sha256(np.ascontiguousarray(sequence.depth(index)).tobytes()).hexdigest()
        for index in range(len(sequence))
    ]
    header, camera = found["header"], sequence.camera
    assert (header["camera"]["fx"], header["camera"]["cy"]) == (camera.fx, camera.cy)
    assert (header["width"], header["height"]) == (camera.width, camera.height)
    assert header["timestamps"] == sequence.timestamps.tolist()
    assert sequence.truth is not None
    assert np.array_equal(np.array(header["truth"]).reshape(-1, 3, 4), sequence.truth[:, :3])


def read(page: Any, name: str, data: bytes, *parameters: object) -> Any:
    return page.evaluate(READ, {"name": name, "data": list(data), "parameters": list(parameters)})


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(3, 5), (1, 1), (7, 2)])
def test_frames_of_any_depths_come_back(web_page: Any, shape: tuple[int, int]) -> None:
    random = np.random.default_rng(sum(shape))
    frames = [random.integers(0, 65536, shape, dtype=np.uint16) for _ in range(3)]
    frames[1][:] = 0
    chunk = codec.encode(frames)
    height, width = shape

    for index, frame in enumerate(frames):
        assert read(web_page, "readFrame", chunk, index, width, height) == frame.ravel().tolist()


def test_a_damaged_chunk_is_refused(web_page: Any) -> None:
    chunk = codec.encode([np.arange(12, dtype=np.uint16).reshape(3, 4)] * 2)
    planes = bytes([100] * 12 + [0] * 12)
    far = b"".join([b"\1\0\0\0\7\0", len(zlib.compress(planes)).to_bytes(4, "little"), zlib.compress(planes)])
    broken = {
        "cut short": chunk[:-3],
        "empty": b"",
        "other bytes": chunk[:40] + bytes(len(chunk) - 40),
        "a rank without a depth": far,
    }

    for what, data in broken.items():
        assert str(
            read(web_page, "readFrame", data, 1 if what != "a rank without a depth" else 0, 4, 3)
        ).startswith("PackError: frame "), what
    assert "not 40" in read(web_page, "readFrame", chunk, 0, 4, 5)
    assert "more than 4 bytes" in read(web_page, "readFrame", chunk, 0, 2, 1)


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ({"format": 2, "kind": "depth"}, "not a depth pack of format 1"),
        ({"format": 1, "kind": "colour"}, "not a depth pack of format 1"),
        ({"format": 1, "kind": "depth", "width": 0}, "not positive whole numbers"),
        (
            {"format": 1, "kind": "depth", "width": 2, "height": 2, "frames": 3, "frames_per_chunk": 10,
             "timestamps": [0], "truth": [None]},
            "one true pose for each frame",
        ),
    ],
)  # fmt: skip
def test_a_header_that_describes_no_depth_is_refused(
    web_page: Any, header: dict[str, object], reason: str
) -> None:
    assert reason in read(web_page, "readHeader", zlib.compress(json.dumps(header).encode()))


def test_a_header_that_is_not_deflated_json_is_refused(web_page: Any) -> None:
    for data in (b"nothing", zlib.compress(b"nothing")):
        assert "PackError: the sequence's header cannot be read" in read(web_page, "readHeader", data)
