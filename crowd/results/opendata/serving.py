"""Files of the open data over HTTP: an ETag that is the file's digest, and ranges of bytes.

With ranges, downloads resume and readers of Parquet fetch only the columns they need.
"""

import hashlib
import io
import re
from dataclasses import dataclass
from typing import BinaryIO

from django.db.models import QuerySet
from django.http import (
    FileResponse,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    HttpResponseNotModified,
)
from django.views.decorators.http import require_safe

from crowd.http.problems import Problem, not_found
from crowd.results.models import Export, ExportFile
from crowd.results.opendata import exports
from crowd.results.opendata.describing import FORMATS, descriptions
from crowd.results.opendata.rewriting import rewrite_stale, root

LATEST = "latest"
PREPARATION_SECONDS = 300
# How long one request may rewrite stale files, and when to ask again where that was not enough.
REWRITING_SECONDS = 5.0
TYPES = {
    "parquet": "application/vnd.apache.parquet",
    "csv": "application/gzip",
    "json": "application/json",
    "text": "text/plain; charset=utf-8",
}
# Longer numbers are beyond any file: such a range is ignored, and the whole file is sent.
RANGE = re.compile(r"bytes=(?P<first>[0-9]{0,18})-(?P<last>[0-9]{0,18})")


@dataclass(frozen=True)
class Content:
    """An open file and what the answer says about it."""

    file: BinaryIO
    bytes: int
    sha256: str
    format: str


@require_safe
def export_file(request: HttpRequest, name: str, file: str) -> HttpResponseBase:
    """FILE of the export NAME, a day or `latest`: whole, or the one range of bytes that is asked for."""
    try:
        export = _export(name, file)
        content = _content(export, file)
    except Problem as problem:
        return problem.response()
    etag = f'"{content.sha256}"'
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        # A file may be rewritten at any moment: a copy is checked before it is used again.
        "Cache-Control": "public, no-cache",
        "Content-Location": f"/data/{export.name}/{file}",
    }
    tags = [tag.strip() for tag in request.headers.get("If-None-Match", "").split(",")]
    if etag in tags or f"W/{etag}" in tags or "*" in tags:
        content.file.close()
        return HttpResponseNotModified(headers=headers)
    kind = TYPES[content.format]
    wanted = request.headers.get("Range", "")
    if request.headers.get("If-Range", etag) != etag or not RANGE.fullmatch(wanted):
        return FileResponse(content.file, content_type=kind, headers=headers)
    return _range(content, wanted, kind, headers)


def _export(name: str, file: str) -> Export:
    """The export with that NAME. Raises Problem: 404 not_found, 410 export_withdrawn, 503
    export_in_preparation.
    """
    if name == LATEST:
        export = exports.published().first()
    else:
        export = exports.made_on(name, exports.published()).first()
    if export is not None:
        return export
    if exports.made_on(name, Export.objects.exclude(withdrawn_at=None)).exists():
        raise Problem(
            410,
            "export_withdrawn",
            f"a participant erased something that the export of {name} held: take /data/{LATEST}/{file}",
        )
    if name == LATEST:
        raise Problem(
            503, "export_in_preparation", "the first export is being written", retry_after=PREPARATION_SECONDS
        )
    raise not_found(f"no export {name!r}: GET /api/v1/exports lists them")


def _content(export: Export, name: str) -> Content:
    """The file NAME of EXPORT without anything that was erased. Raises Problem as `_fresh_row` does."""
    folder = root() / export.folder
    if not folder.is_dir():
        raise not_found(f"the files of {export.name} are not on this machine")
    if name in FORMATS:
        _rewrite(export, name, export.files.all())
        text = descriptions(export)[name]
        return Content(io.BytesIO(text), len(text), hashlib.sha256(text).hexdigest(), FORMATS[name])
    # Between looking up its row and opening it a file may be rewritten, once at most in so short a time.
    for _ in range(2):
        row = _fresh_row(export, name)
        try:
            file = (folder / row.stored_as).open("rb")
        except FileNotFoundError:
            continue
        return Content(file, row.bytes, row.sha256, row.format)
    raise not_found(f"{name} is not on this machine")


def _fresh_row(export: Export, name: str) -> ExportFile:
    """The row of the file NAME, not stale. Raises Problem: 404 not_found, 503 export_in_preparation."""
    rows = export.files.filter(name=name)
    row = rows.first()
    if row is not None and row.stale:
        _rewrite(export, name, rows)
        row = rows.first()
    if row is None:
        raise _unknown(export, name)
    return row


def _rewrite(export: Export, name: str, rows: QuerySet[ExportFile]) -> None:
    """Remove from ROWS what was erased. Raises Problem 503 export_in_preparation where that takes longer."""
    if not rewrite_stale(rows, REWRITING_SECONDS):
        detail = f"{name} of {export.name} is being written again without something that was erased"
        raise Problem(503, "export_in_preparation", detail, retry_after=int(REWRITING_SECONDS))


def _unknown(export: Export, name: str) -> Problem:
    """Why EXPORT has no file NAME: large tables are in numbered parts."""
    table, _, suffix = name.partition(".")
    parts = export.files.filter(table=table, name__endswith=f".{suffix}").count()
    if parts < 2:
        return not_found(f"no file {name!r} in the export of {export.name}")
    return not_found(
        f"{table} of {export.name} has {parts} parts: take {table}-1.{suffix} to {table}-{parts}.{suffix}, "
        "which GET /api/v1/exports lists"
    )


def _range(content: Content, wanted: str, kind: str, headers: dict[str, str]) -> HttpResponseBase:
    """206 with the bytes that WANTED names, 416 where there are none."""
    size = content.bytes
    first, last = _bounds(wanted, size)
    if first > last:
        content.file.close()
        return HttpResponse(status=416, headers=headers | {"Content-Range": f"bytes */{size}"})
    response = FileResponse(_Part(content.file, first, last - first + 1), status=206, content_type=kind)
    for name, value in headers.items():
        response[name] = value
    response["Content-Range"] = f"bytes {first}-{last}/{size}"
    response["Content-Length"] = str(last - first + 1)
    return response


def _bounds(wanted: str, size: int) -> tuple[int, int]:
    """First and last byte, both included; first > last where the range holds none."""
    match = RANGE.fullmatch(wanted)
    assert match is not None  # the caller has looked
    first, last = match["first"], match["last"]
    if first:
        return int(first), min(int(last or size), size - 1)
    return max(size - int(last or 0), 0), size - 1


class _Part:
    """COUNT bytes of FILE from FIRST on, for a FileResponse."""

    def __init__(self, file: BinaryIO, first: int, count: int) -> None:
        file.seek(first)
        self._file, self._left = file, count

    def read(self, size: int) -> bytes:
        """At most SIZE of the bytes that are left; empty at the end."""
        block = self._file.read(min(size, self._left))
        self._left -= len(block)
        return block

    def close(self) -> None:
        self._file.close()
