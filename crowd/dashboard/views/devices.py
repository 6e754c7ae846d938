"""Devices: the list, one of them, several side by side."""

from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse, QueryDict
from django.shortcuts import render

from crowd.dashboard.comparison import InvalidComparisonError, compared, labelled, parse_devices
from crowd.dashboard.figures.frames import stages_height
from crowd.dashboard.figures.speedups import bars_height
from crowd.dashboard.points import newest_figure
from crowd.dashboard.race import race
from crowd.dashboard.stages import stage_table, times_of
from crowd.dashboard.views.page import found, page
from crowd.fronts import selectors as published
from crowd.results import selectors as results
from crowd.results.filters import InvalidFilterError, SpeedupFilters

PAGE = 100


@page
def devices(request: HttpRequest) -> HttpResponse:
    """Every measured device, under the filters of the query string."""
    problem = ""
    try:
        filters = SpeedupFilters.parse(request.GET)
    except InvalidFilterError as error:
        filters, problem = SpeedupFilters(), str(error)
    crowd = results.speedups(filters)
    filtered = filters != SpeedupFilters()
    return render(
        request,
        "dashboard/devices.html",
        {
            "crowd": crowd,
            "filters": filters,
            "part": Paginator(crowd.rows, PAGE).get_page(request.GET.get("page")),
            "filtered": filtered,
            "problem": problem,
            "fronts": published.fronts(filters.application),
            "height": bars_height(len(crowd.rows)),
            "query": "" if problem else _without_page(request.GET),
            "pending": () if filtered else [row for row in results.devices() if row.speedup is None],
        },
        status=400 if problem else 200,
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


def _without_page(query: QueryDict) -> str:
    """The filters alone, for the figure (which shows all pages) and for links to other pages."""
    filters = query.copy()
    filters.pop("page", None)
    return filters.urlencode()
