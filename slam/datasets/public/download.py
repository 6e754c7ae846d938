"""Fetch one large file over HTTP: resumed where the server allows it, checked, and in place only when whole.

During the download, `FILE.partial` and `FILE.partial.json` lie beside `FILE`, afterwards `FILE.sha256`. The
JSON file holds the address and the server's ETag, so that two versions are never joined. A digest that
`FILE.sha256` holds from an earlier fetch is checked again: that does not prove that the first copy was right,
only that this one is the same.
"""

from __future__ import annotations

import hashlib
import http.client
import json
import os
import re
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from slam.datasets.sequence import DigestError, Progress, SequenceError

ATTEMPTS = 5  # in a row without a byte of progress
TIMEOUT = 30.0  # seconds without a byte
BLOCK = 1 << 20


class DownloadError(SequenceError):
    """A file that could not be fetched; what was fetched stays, for the next attempt."""


@dataclass(frozen=True)
class Fetched:
    """A complete file in its place. `checked` says what its digest was compared with."""

    path: Path
    sha256: str
    checked: Literal["published", "recorded", "nothing"]


def fetch(
    address: str,
    target: Path,
    sha256: str | None = None,
    progress: Progress | None = None,
    pause: float = 1.0,
) -> Fetched:
    """Download `address` to `target`, going on where an earlier attempt ended.

    `sha256` is the digest that the publisher gives; without it, the one recorded beside the file counts.
    Without either, the digest is computed and recorded only. `progress` is called with bytes. `pause` is how
    many seconds to wait after an attempt that brought nothing. Raises DownloadError when the server does not
    give the whole file, DigestError when the digest is wrong; a file with a wrong digest is removed.
    """
    if not re.match(r"https?://", address):
        raise DownloadError(f"{address!r} is not an address that starts with http:// or https://")
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.exists():
        partial = _Partial(target, address)
        partial.complete(progress, pause)
        os.replace(partial.path, target)
        partial.note.unlink(missing_ok=True)
    return _check(target, sha256)


class _Partial:
    """The part of one version of a file that was fetched so far."""

    def __init__(self, target: Path, address: str) -> None:
        self.address = address
        self.path = target.with_name(target.name + ".partial")
        self.note = target.with_name(target.name + ".partial.json")

    def complete(self, progress: Progress | None, pause: float) -> None:
        """Request until the file is complete or ATTEMPTS requests in a row brought nothing."""
        failures = 0
        while True:
            before = self._size()
            try:
                if self._ask(progress):
                    return
                trouble = "the connection was cut"
            except urllib.error.HTTPError as error:
                trouble = f"the server answered {error.code} {error.reason}"
                if error.code < 500:
                    raise DownloadError(
                        f"{self.address}: {trouble}: it may have moved, see the dataset's own page"
                    ) from None
            except (OSError, http.client.HTTPException) as error:
                trouble = f"{getattr(error, 'reason', None) or error or type(error).__name__}"
            failures = 0 if self._size() > before else failures + 1
            if failures == ATTEMPTS:
                raise DownloadError(
                    f"{self.address}: {trouble} after {self._size()} bytes: "
                    "run the same command again to go on"
                )
            if failures:
                time.sleep(pause)

    def _ask(self, progress: Progress | None) -> bool:
        """One request for what is missing; whether the file is whole after it."""
        begin, mark = self._size(), self._mark()
        if begin and not mark:  # without an ETag the rest may belong to another version
            begin = 0
        headers = {"Accept-Encoding": "identity", "User-Agent": "frontrunner"}
        if begin:
            headers |= {"Range": f"bytes={begin}-", "If-Range": mark}
        try:
            answer = urllib.request.urlopen(
                urllib.request.Request(self.address, headers=headers), timeout=TIMEOUT
            )
        except urllib.error.HTTPError as error:
            if error.code == 416 and begin:  # the file is complete, or of another version
                if error.headers.get("Content-Range", "") == f"bytes */{begin}":
                    return True
                self.path.unlink()
                return False
            raise
        with answer:
            total = self._total(answer, begin)
            resumed = answer.status == 206
            if not resumed:
                begin = 0
                self._remember(answer.headers)
            with self.path.open("ab" if resumed else "wb") as file:
                while block := answer.read(BLOCK):
                    file.write(block)
                    begin += len(block)
                    if progress:
                        progress(begin, total or begin)
        return total is None or begin == total

    def _total(self, answer: Any, begin: int) -> int | None:
        """Bytes of the whole file, None where the server does not send the length."""
        if answer.status != 206:
            length = answer.headers.get("Content-Length")
            return int(length) if length and length.isdecimal() else None
        match = re.fullmatch(r"bytes (\d+)-\d+/(\d+)", answer.headers.get("Content-Range", ""))
        if match is None or int(match[1]) != begin:
            self.path.unlink(missing_ok=True)
            raise DownloadError(
                f"{self.address}: the server sent a different part from the one requested: try again"
            )
        return int(match[2])

    def _size(self) -> int:
        return self.path.stat().st_size if self.path.exists() else 0

    def _mark(self) -> str:
        """The server's ETag of the partial file's version, or an empty text."""
        try:
            note = json.loads(self.note.read_text(encoding="utf-8"))
            return str(note["mark"]) if note["address"] == self.address else ""
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def _remember(self, headers: Any) -> None:
        etag = headers.get("ETag", "")
        # A weak ETag allows other bytes, and servers do not take it for If-Range.
        mark = headers.get("Last-Modified", "") if not etag or etag.startswith("W/") else etag
        self.note.write_text(json.dumps({"address": self.address, "mark": mark}) + "\n", encoding="utf-8")


def _check(path: Path, published: str | None) -> Fetched:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    record = path.with_name(path.name + ".sha256")
    recorded = record.read_text(encoding="utf-8").split()[:1] if record.exists() else []
    expected = published or (recorded[0] if recorded else None)
    if expected is not None and digest != expected.lower():
        path.unlink()
        source = "its publisher gives" if published else f"{record} records"
        raise DigestError(
            f"{path.name} has the SHA-256 {digest}, {source} {expected}: it was removed, fetch it again"
            + ("" if published else ", and delete the record if the publisher has replaced the file")
        )
    record.write_text(f"{digest}  {path.name}\n", encoding="utf-8")
    return Fetched(path, digest, "published" if published else "recorded" if expected else "nothing")
