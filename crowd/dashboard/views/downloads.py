"""Downloads of all evaluations of an exploration, streamed row by row."""

from collections.abc import Iterator

from django.http import Http404, HttpRequest, HttpResponseBase, StreamingHttpResponse
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

from crowd.demo.mark import file_name
from crowd.explorations.models import Exploration
from crowd.explorations.outcomes.exports import csv_lines, json_lines


@gzip_page
@require_safe
def evaluations_csv(request: HttpRequest, key: int) -> HttpResponseBase:  # noqa: ARG001
    """The exploration's evaluations as CSV."""
    return _file(csv_lines(_exploration(key)), "text/csv", f"exploration-{key}.csv")


@gzip_page
@require_safe
def evaluations_json(request: HttpRequest, key: int) -> HttpResponseBase:  # noqa: ARG001
    """The exploration's evaluations as JSON."""
    return _file(json_lines(_exploration(key)), "application/json", f"exploration-{key}.json")


def _exploration(key: int) -> Exploration:
    exploration = Exploration.objects.filter(pk=key).first()
    if exploration is None:
        raise Http404
    return exploration


def _file(parts: Iterator[str], kind: str, name: str) -> StreamingHttpResponse:
    headers = {"Content-Disposition": f'attachment; filename="{file_name(name)}"'}
    return StreamingHttpResponse(parts, content_type=f"{kind}; charset=utf-8", headers=headers)
