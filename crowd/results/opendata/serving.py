"""Files of the open data over HTTP: an ETag that is the file's digest, and ranges of bytes.

With ranges, downloads resume and readers of Parquet fetch only the columns they need.
"""

import re
from pathlib import Path
from typing import Any, BinaryIO

from django.http import (
    FileResponse,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    HttpResponseNotModified,
)
from django.views.decorators.http import require_safe

from crowd.problems import Problem, not_found
from crowd.results.models import Export
from crowd.results.opendata import exports

LATEST = "latest"
PREPARATION_SECONDS = 300
TYPES = {
    "parquet": "application/vnd.apache.parquet",
    "csv": "application/gzip",
    "json": "application/json",
    "text": "text/plain; charset=utf-8",
}
# Numbers that no file reaches are no range: the whole file is sent.
RANGE = re.compile(r"bytes=(?P<first>[0-9]{0,18})-(?P<last>[0-9]{0,18})")


@require_safe
def export_file(request: HttpRequest, name: str, file: str) -> HttpResponseBase:
    """FILE of the export NAME, a day or `latest`: whole, or the one range of bytes that is asked for."""
    try:
        found, export = _found(name, file)
    except Problem as problem:
        return problem.response()
    path = exports.root() / export.folder / file
    if not path.is_file():
        return not_found(f"{file} is not on this machine").response()
    etag = f'"{found["sha256"]}"'
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        # An export may be withdrawn at any moment: a copy is asked about before it is used again.
        "Cache-Control": "public, no-cache",
        "Content-Location": f"/data/{export.name}/{file}",
    }
    tags = [tag.strip() for tag in request.headers.get("If-None-Match", "").split(",")]
    if etag in tags or f"W/{etag}" in tags or "*" in tags:
        return HttpResponseNotModified(headers=headers)
    kind = TYPES[found["format"]]
    wanted = request.headers.get("Range", "")
    if request.headers.get("If-Range", etag) != etag or not RANGE.fullmatch(wanted):
        return FileResponse(path.open("rb"), content_type=kind, headers=headers)
    return _part(path, found["bytes"], wanted, kind, headers)


def _found(name: str, file: str) -> tuple[dict[str, Any], Export]:
    """What the export's row says of FILE.

    Raises Problem: 404 not_found, 410 export_withdrawn, 503 export_in_preparation.
    """
    if name == LATEST:
        export = exports.published().first()
    else:
        export = exports.made_on(name, exports.published()).first()
    if export is None and exports.made_on(name, Export.objects.exclude(withdrawn_at=None)).exists():
        raise Problem(
            410,
            "export_withdrawn",
            f"a participant erased something that the export of {name} held: take /data/{LATEST}/{file}",
        )
    if export is None and name == LATEST:
        raise Problem(
            503, "export_in_preparation", "the next export is being written", retry_after=PREPARATION_SECONDS
        )
    if export is None:
        raise not_found(f"no export {name!r}: GET /api/v1/exports lists them")
    description = next((each for each in export.files if each["name"] == file), None)
    if description is None:
        raise not_found(f"no file {file!r} in the export of {export.name}")
    return description, export


def _part(path: Path, size: int, wanted: str, kind: str, headers: dict[str, str]) -> HttpResponseBase:
    """206 with the bytes that WANTED names, 416 where there are none."""
    first, last = _bounds(wanted, size)
    if first > last:
        return HttpResponse(status=416, headers=headers | {"Content-Range": f"bytes */{size}"})
    response = FileResponse(_Part(path.open("rb"), first, last - first + 1), status=206, content_type=kind)
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
