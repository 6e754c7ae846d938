"""Whole tables as files: every evaluation of an exploration as CSV or JSON, row by row."""

import csv
import json
from collections.abc import Iterator
from typing import Any

from django.http import Http404, HttpRequest, HttpResponseBase, StreamingHttpResponse
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.services import MEASURED
from slam.system import STAGES

ABOUT = ("number", "phase", "iteration", "label", "state", "attempt", "frames", "worker", "software", "error")
AT_ONCE = 500


class _Line:
    """A file for csv that hands back each line instead of keeping it."""

    def write(self, line: str) -> str:
        return line


@gzip_page
@require_safe
def evaluations_csv(request: HttpRequest, key: int) -> HttpResponseBase:  # noqa: ARG001
    """A line for every evaluation: objectives in SI units, a column for each parameter and stage."""
    exploration = _exploration(key)
    columns = (
        *ABOUT,
        "device",
        "started_at",
        "finished_at",
        *_parameters(exploration),
        *MEASURED,
        *_stages(),
    )
    return _file(_lines(columns, _rows(exploration)), "text/csv", f"exploration-{key}.csv")


@gzip_page
@require_safe
def evaluations_json(request: HttpRequest, key: int) -> HttpResponseBase:  # noqa: ARG001
    """A list with an object for every evaluation; the names are those of the CSV's columns."""
    return _file(_array(_rows(_exploration(key))), "application/json", f"exploration-{key}.json")


def _exploration(key: int) -> Exploration:
    exploration = Exploration.objects.filter(pk=key).first()
    if exploration is None:
        raise Http404
    return exploration


def _parameters(exploration: Exploration) -> list[str]:
    return [parameter["name"] for parameter in exploration.space["parameters"]]


def _stages() -> list[str]:
    return [f"{stage}_seconds" for stage in ("acquisition", *STAGES)]


def _rows(exploration: Exploration) -> Iterator[dict[str, Any]]:
    evaluations = exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number")
    for evaluation in evaluations.iterator(chunk_size=AT_ONCE):
        yield {
            **{name: getattr(evaluation, name) for name in ABOUT},
            "device": (evaluation.device or {}).get("name"),
            **{
                name: moment.isoformat() if (moment := getattr(evaluation, name)) else None
                for name in ("started_at", "finished_at")
            },
            **evaluation.configuration,
            **(evaluation.objectives or {}),
            **{f"{name}_seconds": seconds for name, seconds in (evaluation.stages or {}).items()},
        }


def _lines(columns: tuple[str, ...], rows: Iterator[dict[str, Any]]) -> Iterator[str]:
    writer = csv.DictWriter(_Line(), columns, extrasaction="ignore")
    yield writer.writeheader()
    for row in rows:
        yield writer.writerow(row)


def _array(rows: Iterator[dict[str, Any]]) -> Iterator[str]:
    before = "[\n"
    for row in rows:
        yield before + json.dumps(row)
        before = ",\n"
    yield "\n]\n" if before == ",\n" else "[]\n"


def _file(parts: Iterator[str], kind: str, name: str) -> StreamingHttpResponse:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingHttpResponse(parts, content_type=f"{kind}; charset=utf-8", headers=headers)
