"""Devices: the list, one of them, several side by side."""

from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.comparison import InvalidComparisonError, compared, labelled, parse_devices
from crowd.dashboard.drawings.speedups import colour_of
from crowd.dashboard.figures.frames import stages_height
from crowd.dashboard.figures.speedups import bars_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.dashboard.points import newest_figure
from crowd.dashboard.race import race
from crowd.dashboard.stages import stage_table, times_of
from crowd.dashboard.views.page import found, page
from crowd.results import selectors as results

PAGE = 100


@filtered
def devices(request: HttpRequest, asked: Filtering) -> HttpResponse:
    """Every measured device, under the filters of the query string."""
    crowd = results.speedups(asked.filters)
    return render(
        request,
        "dashboard/devices.html",
        {
            "asked": asked,
            "colour": colour_of(request),
            "crowd": crowd,
            "part": Paginator(crowd.rows, PAGE).get_page(request.GET.get("page")),
            "height": bars_height(len(crowd.rows)),
            "query": asked.query,
            "pending": () if asked.filtered else [row for row in results.devices() if row.speedup is None],
        },
    )


@page
def device(request: HttpRequest, slug: str) -> HttpResponse:
    """One device: its speedup, its newest session frame by frame, its sessions, what it says of itself."""
    detail = found(results.device(slug))
    figure = newest_figure(detail)
    stages = times_of(detail.latest)
    return render(
        request,
        "dashboard/device.html",
        {
            "detail": detail,
            "device": detail.device,
            "protocol": detail.latest.protocol if detail.latest else {},
            "figure": figure,
            "lanes": race(figure.speedup if figure else None),
            "stages": stages,
            "stage_table": stage_table(stages),
            "stages_height": stages_height(len(stages)),
        },
    )


@page
def compare(request: HttpRequest) -> HttpResponse:
    """Two to six devices side by side."""
    problem, columns = "", []
    try:
        slugs = parse_devices(request.GET.getlist("devices"))
        columns = [compared(found(results.device(slug))) for slug in slugs]
    except InvalidComparisonError as error:
        problem = str(error)
    rows = labelled(columns)
    return render(
        request,
        "dashboard/compare.html",
        {
            "columns": columns,
            "problem": problem,
            "query": request.GET.urlencode(),
            "runs": sum(row.runs for row in rows),
            "height": stages_height(len(rows)),
        },
        status=400 if problem else 200,
    )
