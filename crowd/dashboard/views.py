"""Pages: each parses, asks a selector, and renders."""

from collections.abc import Callable
from typing import Any, TypeVar
from uuid import UUID

from django.core.paginator import Paginator
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, QueryDict
from django.shortcuts import render
from django.utils import timezone
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

from crowd.dashboard.comparison import InvalidComparisonError, compared, labelled, parse_devices
from crowd.dashboard.exported import newest, tables_of
from crowd.dashboard.figures.frames import stages_height
from crowd.dashboard.figures.speedups import bars_height
from crowd.dashboard.points import measured_points, newest_figure, parameters_of
from crowd.dashboard.protocols import first_counted_frame
from crowd.dashboard.race import race
from crowd.dashboard.searches import ate_limit, yield_of
from crowd.dashboard.stages import StageTimes, frames, spread, stage_table, stage_times
from crowd.dashboard.versions import UnknownVersionError, beside
from crowd.explorations import selectors as searches
from crowd.explorations.insights import milestone
from crowd.explorations.models import Evaluation
from crowd.explorations.watching import Watch, found, watch
from crowd.fronts import selectors as published
from crowd.fronts.selectors import BEST
from crowd.results import selectors as results
from crowd.results.filters import ALL, InvalidFilterError, SpeedupFilters
from crowd.results.opendata.tables import LICENCE
from crowd.results.rows import SessionDetail

APPLICATION = "kfusion"
NEWEST = 6
PAGE = 100
EVALUATIONS = 50

Row = TypeVar("Row")
View = TypeVar("View", bound=Callable[..., HttpResponseBase])


def page(view: View) -> View:
    """A view that only reads, compressed: these pages hold no secret that compression could give away."""
    return gzip_page(require_safe(view))


@page
def home(request: HttpRequest) -> HttpResponse:
    """The crowd's answer: how many devices, how much faster, and how to add one's own."""
    crowd = results.speedups(SpeedupFilters())
    front = published.front(crowd.front) if crowd.front else None
    return render(
        request,
        "dashboard/home.html",
        {
            "crowd": crowd,
            "front": front,
            "protocol": front.protocol if front else {},
            "lanes": race(crowd.headline.geometric_mean),
            "sessions": results.latest_sessions(NEWEST),
            "height": bars_height(len(crowd.rows)),
        },
    )


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
    detail = _found(results.device(slug))
    figure = newest_figure(detail)
    stages = _stage_times(detail.latest)
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
        columns = [compared(_found(results.device(slug))) for slug in slugs]
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


@page
def session(request: HttpRequest, uuid: UUID) -> HttpResponse:
    """One session: its answer, and the runs that it rests on."""
    detail = _found(results.session(uuid))
    stages = _stage_times(detail)
    return render(
        request,
        "dashboard/session.html",
        {
            "detail": detail,
            "session": detail.session,
            "protocol": detail.protocol,
            "lanes": race(best.speedup if (best := detail.session.speedup(BEST)) else None),
            "stages": stages,
            "stage_table": stage_table(stages),
            "stages_height": stages_height(len(stages)),
        },
    )


@page
def run(request: HttpRequest, uuid: UUID) -> HttpResponse:
    """One run: its frames, where the time went, and whether it counts."""
    detail = _found(results.run(uuid))
    first_counted = first_counted_frame(detail.protocol)
    return render(
        request,
        "dashboard/run.html",
        {
            "detail": detail,
            "run": detail.run.run,
            "protocol": detail.protocol,
            "spread": spread(detail.run, first_counted),
            "frames": frames(detail.run, first_counted),
        },
    )


@page
def fronts(request: HttpRequest) -> HttpResponse:
    """Every published front, newest first."""
    return render(request, "dashboard/fronts.html", {"fronts": published.fronts()})


@page
def front(request: HttpRequest, slug: str) -> HttpResponse:
    """One front: its points as predicted and as the crowd measures them, and what another version had."""
    shown = _found(published.front(slug))
    others = [version for version in published.fronts(shown.application) if version.slug != slug]
    problem = ""
    try:
        difference = beside(shown, others, request.GET.get("against", ""))
    except UnknownVersionError as error:
        difference, problem = beside(shown, others, ""), str(error)
    crowd = results.speedups(SpeedupFilters(front=slug, application=shown.application, configuration=ALL))
    return render(
        request,
        "dashboard/front.html",
        {
            "front": shown,
            "points": measured_points(shown, crowd.rows),
            "parameters": parameters_of(shown),
            "others": others,
            "difference": difference,
            "problem": problem,
        },
        status=400 if problem else 200,
    )


@page
def explorations(request: HttpRequest) -> HttpResponse:
    """Every search, newest first."""
    return render(request, "dashboard/explorations.html", {"explorations": searches.explorations()})


@page
def exploration(request: HttpRequest, key: int) -> HttpResponse:
    """One search: how far it is, what it found, and every evaluation."""
    return render(request, "dashboard/exploration.html", _exploration(request, _found(watch(key))))


@page
def exploration_live(request: HttpRequest, key: int) -> HttpResponseBase:
    """The part of an exploration's page that changes while it runs; 304 where the caller has it."""
    seen = _found(watch(key))
    etag = quote_etag(_version(request, seen))
    if (unchanged := get_conditional_response(request, etag=etag)) is not None:
        return unchanged
    response = render(request, "dashboard/exploration_live.html", _exploration(request, seen))
    response["ETag"] = etag
    response["Cache-Control"] = "no-cache"
    return response


@page
def data(request: HttpRequest) -> HttpResponse:
    """Where the raw numbers are, and what each field means."""
    export = newest()
    return render(
        request,
        "dashboard/data.html",
        {"export": export, "tables": tables_of(export) if export else (), "licence": LICENCE},
    )


@page
def about(request: HttpRequest) -> HttpResponse:
    """What is measured, how a figure comes about, and what is known of the people behind it."""
    front = published.current(APPLICATION)
    return render(
        request, "dashboard/about.html", {"front": front, "protocol": front.protocol if front else {}}
    )


def _exploration(request: HttpRequest, seen: Watch) -> dict[str, Any]:
    have = found(seen)
    evaluations = seen.exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number")
    return {
        "seen": seen,
        "version": _version(request, seen),
        "staff": _staff(request),
        "have": have,
        "exploration": seen.exploration,
        "yield": yield_of(seen.exploration, have),
        "limit": ate_limit(seen.exploration),
        "parameters": tuple(have.front[0].configuration) if have.front else (),
        "part": Paginator(evaluations, EVALUATIONS).get_page(request.GET.get("page")),
        "learnt": milestone(len(have.indices)),
        "now": timezone.now(),
    }


def _version(request: HttpRequest, seen: Watch) -> str:
    """By which a page tells whether its live part is still right; who measures is shown to staff only."""
    return f"{seen.version}-staff" if _staff(request) else seen.version


def _staff(request: HttpRequest) -> bool:
    return request.user.is_authenticated and request.user.is_staff


def _without_page(query: QueryDict) -> str:
    """The filters alone, for the figure (which shows all pages) and for links to other pages."""
    filters = query.copy()
    filters.pop("page", None)
    return filters.urlencode()


def _stage_times(session: SessionDetail | None) -> tuple[StageTimes, ...]:
    return () if session is None else stage_times(session.runs, first_counted_frame(session.protocol))


def _found(row: Row | None) -> Row:
    if row is None:
        raise Http404
    return row
