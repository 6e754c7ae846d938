"""Serves files of the open data over HTTP, with a digest as ETag and with byte ranges.

With ranges, downloads can resume, and readers of Parquet fetch only the columns that they need.
"""

import io
import re
from contextlib import suppress
from typing import IO

from django.http import (
    FileResponse,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    HttpResponseNotModified,
)
from django.views.decorators.http import require_safe

from crowd.demo.mark import file_name
from crowd.http.problems import Problem, not_found
from crowd.results.marking import DIGESTS
from crowd.results.models import Export, StoredFile
from crowd.results.opendata.releases import find_export
from crowd.results.opendata.rewriting import rewrite_stale
from crowd.results.opendata.storing import open_stored

# How long a request may rewrite stale files. If that is not enough, the client retries after this time.
REWRITING_SECONDS = 5.0
TYPES = {
    "parquet": "application/vnd.apache.parquet",
    "csv": "application/gzip",
    "json": "application/json",
    "text": "text/plain; charset=utf-8",
    "python": "text/x-python; charset=utf-8",
}
# A range with longer numbers is beyond any file: it is ignored, and the whole file is sent.
RANGE = re.compile(r"bytes=(?P<first>[0-9]{0,18})-(?P<last>[0-9]{0,18})")


@require_safe
def export_file(request: HttpRequest, name: str, file: str) -> HttpResponseBase:
    """`file` of the export `name` (a day or `latest`): whole, or one byte range."""
    try:
        export = find_export(name)
        # A file may be rewritten between the read of its row and its opening, at most once in that time.
        for _ in range(2):
            with suppress(FileNotFoundError):
                return _answer(request, export, file)
        raise not_found(f"{file} of {export.name} is not on this machine: ask its operator")
    except Problem as problem:
        return problem.response()


def _answer(request: HttpRequest, export: Export, name: str) -> HttpResponseBase:
    """The file `name` of `export` without erased data.

    Raises Problem as `_fresh_row` does, FileNotFoundError if its content is not there.
    """
    stored = _fresh_row(export, name)
    etag = f'"{stored.sha256}"'
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        # A file may be rewritten at any time: caches must revalidate.
        "Cache-Control": "public, no-cache",
        "Content-Location": f"/data/{export.name}/{name}",
    }
    tags = [tag.strip() for tag in request.headers.get("If-None-Match", "").split(",")]
    if etag in tags or f"W/{etag}" in tags or "*" in tags:
        return HttpResponseNotModified(headers=headers)
    status, first, last = 200, 0, stored.bytes - 1
    wanted = request.headers.get("Range", "")
    if request.headers.get("If-Range", etag) == etag and RANGE.fullmatch(wanted):
        status = 206
        first, last = _byte_bounds(wanted, stored.bytes)
        if first > last:
            return HttpResponse(status=416, headers=headers | {"Content-Range": f"bytes */{stored.bytes}"})
        headers["Content-Range"] = f"bytes {first}-{last}/{stored.bytes}"
    response = FileResponse(
        _open(request, stored, first, last - first + 1),
        status=status,
        content_type=TYPES[stored.format],
        headers=headers,
        filename=file_name(name),
    )
    response["Content-Length"] = str(last - first + 1)
    return response


def _open(request: HttpRequest, stored: StoredFile, first: int, count: int) -> "_FileRange":
    """The `count` bytes of `stored` from the byte `first` on."""
    file: io.BufferedReader = open_stored(stored).file  # type: ignore[assignment]
    file.seek(first)
    if request.method == "GET":
        file.peek(1)  # a bucket begins to send now: an erasure may delete the file before the first read
    return _FileRange(file, count)


def _fresh_row(export: Export, name: str) -> StoredFile:
    """The row of the file `name`, rewritten if stale.

    Raises Problem: 404 not_found, 503 export_in_preparation.
    """
    rows = export.files.filter(name=name)
    row = rows.first()
    if row is not None and row.stored.stale:
        # The digests of all files are in some.
        needed = export.files.all() if row.stored.table in DIGESTS else rows
        if not rewrite_stale(needed, REWRITING_SECONDS):
            detail = f"{name} of {export.name} is being rewritten without erased data"
            raise Problem("export_in_preparation", detail, retry_after=int(REWRITING_SECONDS))
        row = rows.first()
    if row is None:
        raise _unknown_file(export, name)
    return row.stored


def _unknown_file(export: Export, name: str) -> Problem:
    """404 for the file `name`. Names the parts, if the table has several."""
    table, _, suffix = name.partition(".")
    parts = export.files.filter(stored__table=table, name__endswith=f".{suffix}").count()
    if parts < 2:
        return not_found(f"no file {name!r} in the export of {export.name}")
    return not_found(
        f"{table} of {export.name} has {parts} parts: use {table}-1.{suffix} to {table}-{parts}.{suffix}, "
        "which GET /api/v1/exports lists"
    )


def _byte_bounds(wanted: str, size: int) -> tuple[int, int]:
    """The first and last byte of `wanted`, both included; first > last for an empty range."""
    match = RANGE.fullmatch(wanted)
    assert match is not None  # checked by the caller
    first, last = match["first"], match["last"]
    if first:
        return int(first), min(int(last or size), size - 1)
    return max(size - int(last or 0), 0), size - 1


class _FileRange:
    """The next `count` bytes of `file`, for a FileResponse."""

    def __init__(self, file: IO[bytes], count: int) -> None:
        self._file, self._left = file, count

    def read(self, size: int) -> bytes:
        """At most `size` of the bytes that are left; empty at the end."""
        block = self._file.read(min(size, self._left))
        self._left -= len(block)
        return block

    def close(self) -> None:
        self._file.close()
