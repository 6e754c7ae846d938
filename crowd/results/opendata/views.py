"""The list of exports in the API."""

import hashlib
from datetime import datetime

import msgspec
from django.http import HttpResponse
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, json_response, paginate
from crowd.results.models import Export
from crowd.results.opendata import exports
from crowd.results.opendata.description_files import DATA_PACKAGE, FORMATS, descriptions, ordered_files
from crowd.results.opendata.serving import LATEST, REWRITING_SECONDS
from crowd.results.opendata.tables import LICENCE


class ExportFile(msgspec.Struct):
    """A file of an export. `table` and `rows` are null for files that describe the others.

    A `stale` file contains erased data. It is rewritten before it is served: size and digest change.
    """

    name: str
    table: str | None
    format: str
    rows: int | None
    bytes: int
    sha256: str
    stale: bool
    url: str
    latest_url: str


class ExportAnswer(msgspec.Struct):
    """An export. `name` is its day, `schema` the address of the description of its columns."""

    name: str
    created_at: datetime
    licence: str
    licence_url: str
    schema: str
    files: list[ExportFile]


class ExportPage(msgspec.Struct):
    """Exports, newest first."""

    results: list[ExportAnswer]
    next: str | None


class ExportsView(Endpoint):
    """The exports of the open data."""

    @extend_schema(
        operation_id="exports",
        summary="Exports of the open data, newest first",
        description=(
            "Parquet and CSV of all runs, sessions, summaries, figures, devices, configurations and "
            "tombstones. /data/latest/FILE is always the newest. Large tables have several parts, such as "
            "runs-1.parquet and runs-2.parquet. After an erasure, files that contained the erased data are "
            "rewritten: their digests change."
        ),
        parameters=[OpenApiParameter("cursor", str), OpenApiParameter("limit", int)],
        responses={200: ExportPage},
    )
    def get(self, request: Request) -> HttpResponse:
        exports.rewrite_all(REWRITING_SECONDS)
        return json_response(
            paginate(request, exports.listed_exports(), lambda export: export.name, export_answer)
        )


def export_answer(export: Export) -> ExportAnswer:
    """An export as JSON."""
    files = ordered_files(export)
    answers = [
        _file(export, file.name, file.format, file.sha256, file.bytes, file.stale, file.table, file.rows)
        for file in files
    ]
    stale = any(file.stale for file in files)
    answers += [
        _file(export, name, FORMATS[name], hashlib.sha256(text).hexdigest(), len(text), stale)
        for name, text in descriptions(export).items()
    ]
    return ExportAnswer(
        name=export.name,
        created_at=export.started_at,
        licence=LICENCE["name"],
        licence_url=LICENCE["path"],
        schema=f"/data/{export.name}/{DATA_PACKAGE}",
        files=answers,
    )


def _file(
    export: Export,
    name: str,
    format: str,
    sha256: str,
    size: int,
    stale: bool,
    table: str | None = None,
    rows: int | None = None,
) -> ExportFile:
    return ExportFile(
        name=name,
        table=table,
        format=format,
        rows=rows,
        bytes=size,
        sha256=sha256,
        stale=stale,
        url=f"/data/{export.name}/{name}",
        latest_url=f"/data/{LATEST}/{name}",
    )
