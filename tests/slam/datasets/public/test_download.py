import hashlib
import http.server
import json
import threading

import numpy as np
import pytest

from slam.datasets import DigestError
from slam.datasets.public.download import DownloadError, fetch

CONTENT = np.random.default_rng(0).bytes(300_000)
DIGEST = hashlib.sha256(CONTENT).hexdigest()


class Server(http.server.ThreadingHTTPServer):
    """Serves CONTENT; `cuts` lists after how many bytes the next answers break off."""

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.content, self.etag, self.ranges, self.length = CONTENT, '"one"', True, True
        self.cuts, self.errors, self.asked = [], [], []

    @property
    def address(self):
        return f"http://127.0.0.1:{self.server_port}/room.tgz"


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        server = self.server
        wanted = self.headers.get("Range")
        server.asked.append(wanted)
        if server.errors:
            self.send_error(server.errors.pop(0))
            return
        content, begin = server.content, 0
        if wanted and server.ranges and self.headers.get("If-Range") == server.etag:
            begin = int(wanted.removeprefix("bytes=").removesuffix("-"))
            if begin >= len(content):
                self.send_response(416)
                self.send_header("Content-Range", f"bytes */{len(content)}")
                self.send_header("Content-Length", "0")
                self.end_headers()
                return
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {begin}-{len(content) - 1}/{len(content)}")
        else:
            self.send_response(200)
        if server.etag:
            self.send_header("ETag", server.etag)
        if server.length:
            self.send_header("Content-Length", str(len(content) - begin))
        self.end_headers()
        part = content[begin:]
        self.wfile.write(part[: server.cuts.pop(0)] if server.cuts else part)

    def log_message(self, *_):
        pass


@pytest.fixture
def server():
    with Server() as running:
        threading.Thread(target=running.serve_forever, args=(0.01,), daemon=True).start()
        yield running
        running.shutdown()


@pytest.fixture
def target(tmp_path):
    return tmp_path / "new" / "room.tgz"


def test_a_file_is_fetched_and_its_digest_recorded(server, target):
    seen = []
    fetched = fetch(server.address, target, progress=lambda done, total: seen.append((done, total)))
    assert target.read_bytes() == CONTENT
    assert (fetched.sha256, fetched.checked) == (DIGEST, "nothing")
    assert seen[-1] == (300_000, 300_000)
    assert sorted(path.name for path in target.parent.iterdir()) == ["room.tgz", "room.tgz.sha256"]
    assert (target.parent / "room.tgz.sha256").read_text() == f"{DIGEST}  room.tgz\n"


def test_a_cut_connection_is_gone_on_with_where_it_broke(server, target):
    server.cuts = [100_000, 50_000]
    fetch(server.address, target)
    assert target.read_bytes() == CONTENT
    assert server.asked == [None, "bytes=100000-", "bytes=150000-"]


def test_another_run_goes_on_where_the_last_ended(server, target):
    server.cuts = [100_000, 0, 0, 0, 0, 0]
    with pytest.raises(DownloadError, match="after 100000 bytes: run the same command again"):
        fetch(server.address, target, pause=0)
    assert not target.exists()
    server.asked.clear()
    fetch(server.address, target)
    assert target.read_bytes() == CONTENT
    assert server.asked == ["bytes=100000-"]


@pytest.mark.parametrize(
    ("lacking", "cuts", "asked"),
    [
        ({"ranges": False}, [100_000], [None, "bytes=100000-"]),
        ({"etag": None}, [100_000], [None, None]),  # no version: everything again
        ({"length": False}, [], [None]),
    ],
    ids=str,
)
def test_a_server_that_cannot_all_of_it_is_asked_for_everything(server, target, lacking, cuts, asked):
    vars(server).update(lacking, cuts=cuts)
    fetch(server.address, target)
    assert target.read_bytes() == CONTENT
    assert server.asked == asked


def test_a_file_that_was_replaced_meanwhile_is_not_joined_with_the_old_one(server, target):
    server.cuts = [100_000, 0, 0, 0, 0, 0]
    with pytest.raises(DownloadError):
        fetch(server.address, target, pause=0)
    server.content, server.etag = CONTENT[::-1], '"two"'
    fetch(server.address, target)
    assert target.read_bytes() == CONTENT[::-1]


@pytest.mark.parametrize(
    ("partial", "elsewhere", "asked"),
    [
        (b"old", True, [None]),
        (CONTENT, False, ["bytes=300000-"]),
        (CONTENT + b"more", False, ["bytes=300004-", None]),
    ],
    ids=["of another address", "whole", "too long"],
)
def test_a_partial_file_is_taken_where_it_belongs_to_the_whole(server, target, partial, elsewhere, asked):
    target.parent.mkdir()
    target.with_name("room.tgz.partial").write_bytes(partial)
    note = {"address": "http://elsewhere/" if elsewhere else server.address, "mark": '"one"'}
    target.with_name("room.tgz.partial.json").write_text(json.dumps(note))
    fetch(server.address, target, pause=0)
    assert target.read_bytes() == CONTENT
    assert server.asked == asked


def test_the_published_digest_is_checked(server, target):
    assert fetch(server.address, target, DIGEST.upper()).checked == "published"


def test_a_wrong_published_digest_removes_the_file(server, target):
    with pytest.raises(DigestError, match="its publisher gives 00"):
        fetch(server.address, target, "00" * 32)
    assert not target.exists()


def test_the_recorded_digest_is_checked_when_the_file_is_fetched_again(server, target):
    fetch(server.address, target)
    target.unlink()
    assert fetch(server.address, target).checked == "recorded"
    target.unlink()
    server.content = CONTENT[:-1]
    with pytest.raises(DigestError, match="delete the record if the publisher has replaced the file"):
        fetch(server.address, target)


def test_a_file_that_is_there_is_checked_and_not_fetched(server, target):
    fetch(server.address, target)
    assert fetch(server.address, target).checked == "recorded"
    assert len(server.asked) == 1


def test_a_missing_file_is_an_error_at_once(server, target):
    server.errors = [404]
    with pytest.raises(DownloadError, match="404 Not Found: it may have moved"):
        fetch(server.address, target)
    assert len(server.asked) == 1
    assert not target.exists()


def test_a_server_that_is_busy_is_asked_again(server, target):
    server.errors = [503, 500]
    fetch(server.address, target, pause=0)
    assert target.read_bytes() == CONTENT


def test_nobody_there_is_a_clear_error(server, target):
    address = server.address.replace(str(server.server_port), "9")
    with pytest.raises(DownloadError, match="refused"):
        fetch(address, target, pause=0)


@pytest.mark.parametrize("address", ["file:///etc/passwd", "ftp://host/x", "room.tgz"])
def test_only_http_is_fetched(target, address):
    with pytest.raises(DownloadError, match="not an address that starts with http"):
        fetch(address, target)
