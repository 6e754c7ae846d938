"""The list of exports in the API."""

from datetime import datetime

import msgspec
from django.http import HttpResponse
from drf_spectacular.utils import OpenApiParameter, extend_schema
from rest_framework.request import Request

from crowd.api import Endpoint, answer, page
from crowd.results.models import Export
from crowd.results.opendata import exports
from crowd.results.opendata.serving import LATEST
from crowd.results.opendata.tables import LICENCE


class ExportFile(msgspec.Struct):
    """A file: table and rows are null for those that describe the others."""

    name: str
    table: str | None
    format: str
    rows: int | None
    bytes: int
    sha256: str
    url: str
    latest_url: str


class ExportAnswer(msgspec.Struct):
    """An export: name is its day; schema is the address of the description of all columns."""

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
    """Where the open data can be had."""

    @extend_schema(
        operation_id="exports",
        summary="Exports of the open data, newest first",
        description=(
            "Parquet and CSV of all runs, sessions, summaries, figures, devices, configurations and "
            "tombstones. /data/latest/FILE is always the newest. An export is withdrawn when something in it "
            "is erased: its files then answer 410."
        ),
        parameters=[OpenApiParameter("cursor", str), OpenApiParameter("limit", int)],
        responses={200: ExportPage},
    )
    def get(self, request: Request) -> HttpResponse:
        return answer(page(request, exports.listed(), lambda export: export.name, export_answer))


def export_answer(export: Export) -> ExportAnswer:
    """An export as JSON."""
    return ExportAnswer(
        name=export.name,
        created_at=export.started_at,
        licence=LICENCE["name"],
        licence_url=LICENCE["path"],
        schema=f"/data/{export.name}/datapackage.json",
        files=[
            ExportFile(
                **file,
                url=f"/data/{export.name}/{file['name']}",
                latest_url=f"/data/{LATEST}/{file['name']}",
            )
            for file in export.files
        ],
    )
