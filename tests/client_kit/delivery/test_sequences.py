"""The sequence's download: every chunk checked, whatever came before kept."""

import json
from pathlib import Path

import pytest

from client_kit.delivery import sequences
from client_kit.delivery.downloads import CorruptDownloadError
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import Server, UnreachableError
from client_kit.home import Home
from slam.datasets.formats.pack import Pack, colour_folder
from tests.builders import manifests
from tests.client_kit.scripted import Reply, Request, Serve, always, at_first
from tests.slam.tiny import write_tiny_pack

CHUNKS = (b"the header", b"frames 0 to 9" * 100, b"frames 10 to 11")
ASKED = Manifest.parse(manifests.manifest(CHUNKS)).sequence
ADDRESSES = {f"/sequences/{manifests.digest(chunk)}": chunk for chunk in CHUNKS}


def whole(request: Request) -> Reply:
    return Reply(200, raw=ADDRESSES[request.path])


def no_pause(_: float) -> None:
    pass


def test_a_download_is_a_pack_and_happens_once(serve: Serve, home: Home) -> None:
    scripted = serve(whole)
    progress: list[tuple[int, int]] = []
    assert sequences.find_complete(ASKED, home) is None

    folder = sequences.fetch(
        Server(scripted.url), ASKED, home, lambda done, total: progress.append((done, total))
    )

    assert [(folder / "chunks" / manifests.digest(chunk)).read_bytes() for chunk in CHUNKS] == list(CHUNKS)
    description = json.loads((folder / "pack.json").read_text())
    assert description["sha256"] == ASKED.sha256
    assert description["chunks"][0] == {"sha256": manifests.digest(CHUNKS[0]), "bytes": len(CHUNKS[0])}
    total = sum(map(len, CHUNKS))
    assert progress == [(10, total), (1310, total), (total, total)]
    assert sequences.find_complete(ASKED, home) == folder
    sequences.fetch(Server(scripted.url), ASKED, home)
    assert len(scripted.requests) == len(CHUNKS)


def test_an_interrupted_download_goes_on_where_it_stopped(serve: Serve, home: Home) -> None:
    last = f"/sequences/{manifests.digest(CHUNKS[2])}"
    scripted = serve(always(last, Reply(200, raw=CHUNKS[2], cut=3), whole))
    with pytest.raises(UnreachableError):
        sequences.fetch(Server(scripted.url), ASKED, home, pause=no_pause)
    assert sequences.find_complete(ASKED, home) is None

    scripted.answer, before = whole, len(scripted.requests)
    sequences.fetch(Server(scripted.url), ASKED, home, pause=no_pause)

    assert scripted.paths()[before:] == [f"GET {last}"]


def test_a_chunk_that_was_damaged_on_disk_is_fetched_again(serve: Serve, home: Home) -> None:
    scripted = serve(whole)
    folder = sequences.fetch(Server(scripted.url), ASKED, home)
    damaged = folder / "chunks" / manifests.digest(CHUNKS[1])
    damaged.write_bytes(b"frames 0 to 9?" * 100)

    assert sequences.find_complete(ASKED, home) is None
    sequences.fetch(Server(scripted.url), ASKED, home)

    assert damaged.read_bytes() == CHUNKS[1]


def test_trouble_on_the_way_is_tried_again_after_growing_pauses(serve: Serve, home: Home) -> None:
    troubles = [Reply(503, raw=b"", headers=(("Retry-After", "9"),)), Reply(200, raw=b"the h", cut=2)]
    server = Server(serve(at_first("/sequences/", *troubles, then=whole)).url)
    pauses: list[float] = []

    sequences.fetch(server, ASKED, home, pause=pauses.append)

    assert pauses == [9.0, 2.0]


def test_other_bytes_than_promised_are_never_kept(serve: Serve, home: Home) -> None:
    scripted = serve(lambda _: Reply(200, raw=b"the hEader"))

    with pytest.raises(CorruptDownloadError, match="does not match the manifest"):
        sequences.fetch(Server(scripted.url), ASKED, home, pause=no_pause)

    assert not (home.sequence(ASKED.sha256) / "chunks").exists()


def test_colour_of_the_manifest_is_stored_beside_the_depth(serve: Serve, home: Home, tmp_path: Path) -> None:
    original = Pack(write_tiny_pack(tmp_path, colour=True))
    beside = original.colour_manifest
    assert beside is not None
    sequence = original.manifest | {"colour": {name: beside[name] for name in ("name", "sha256", "chunks")}}
    for chunk in (*sequence["chunks"], *beside["chunks"]):
        chunk["url"] = f"/sequences/{chunk['sha256']}"
    asked = Manifest.parse(manifests.manifest(sequence=sequence)).sequence
    chunks = {path.name: path.read_bytes() for path in tmp_path.glob("tiny*/chunks/*")}
    scripted = serve(lambda request: Reply(200, raw=chunks[Path(request.path).name]))

    folder = sequences.fetch(Server(scripted.url), asked, home)

    assert sequences.size(asked) == sum(chunk["bytes"] for chunk in (*sequence["chunks"], *beside["chunks"]))
    fetched = Pack(folder)
    assert (fetched.colour(3) == original.colour(3)).all()
    assert sequences.find_complete(asked, home) == folder
    (colour_folder(folder) / "chunks" / beside["chunks"][0]["sha256"]).unlink()
    assert sequences.find_complete(asked, home) is None
