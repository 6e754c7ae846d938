"""The list of exports in the API."""

from datetime import datetime

import msgspec
from django.http import HttpResponseBase
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.http.api import Endpoint, paginate, public_json
from crowd.results.models import Export
from crowd.results.models.exports import LATEST
from crowd.results.opendata import exports
from crowd.results.opendata.description_files import DATA_PACKAGE, ordered_files
from crowd.results.opendata.releases import listed_exports
from crowd.results.opendata.serving import REWRITING_SECONDS
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
    """An export. `name` is its day, or `latest` where an earlier export has the address of that day.

    A `release` stays: cite it. `schema` is the address of the description of its columns.
    """

    name: str
    created_at: datetime
    release: bool
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
            "Parquet and CSV of all runs and their states, sessions, summaries, figures, devices, "
            "configurations and tombstones. /data/latest/FILE is always the newest. A release stays, others "
            "are kept for a week. Large tables have several parts, such as runs-1.parquet and "
            "runs-2.parquet. After an erasure, files that contained the erased data are rewritten: their "
            "digests change."
        ),
        parameters=[OpenApiParameter("cursor", str), OpenApiParameter("limit", int)],
        responses={200: ExportPage},
    )
    def get(self, request: Request) -> HttpResponseBase:
        exports.rewrite_all(REWRITING_SECONDS)
        page = paginate(request, listed_exports(), lambda export: export.name, export_answer)
        return public_json(request, page)


def export_answer(export: Export) -> ExportAnswer:
    """An export as JSON."""
    return ExportAnswer(
        name=export.name,
        created_at=export.started_at,
        release=export.release,
        licence=LICENCE["name"],
        licence_url=LICENCE["path"],
        schema=f"/data/{export.name}/{DATA_PACKAGE}",
        files=[
            ExportFile(
                name=file.name,
                table=file.stored.table if file.stored.rows is not None else None,
                format=file.stored.format,
                rows=file.stored.rows,
                bytes=file.stored.bytes,
                sha256=file.stored.sha256,
                stale=file.stored.stale,
                url=f"/data/{export.name}/{file.name}",
                latest_url=f"/data/{LATEST}/{file.name}",
            )
            for file in ordered_files(export)
        ],
    )
