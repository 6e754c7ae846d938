"""The list of explorations, the page of one, and the part of it that changes while it runs."""

from typing import Any

from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.utils import timezone

from crowd.dashboard import formats
from crowd.dashboard.content.parameter_bars import ParameterBars, Row, parameter_bars
from crowd.dashboard.content.searches import ate_limit, measured_again, outcome_of
from crowd.dashboard.figures.explorations import importance_height
from crowd.dashboard.responses import or_404, page, respond_with_etag
from crowd.explorations import selectors as searches
from crowd.explorations.models import Evaluation
from crowd.explorations.outcomes import watching
from crowd.explorations.outcomes.insights import LEAST, milestone
from crowd.explorations.outcomes.results_cache import SearchResults
from crowd.explorations.outcomes.watching import ExplorationStatus, watch
from crowd.explorations.searching.points import Point, default_point, spread

EVALUATIONS = 50
LISTED = 25  # points of a front, spread along it
TAILS = ("runtime_p95", "runtime_max")  # columns that only some explorations have
# The columns of the table; others hold whole trajectories.
SHOWN = ("exploration", "number", "phase", "state", "label", "objectives", "censored", "parts", "error")


@page
def explorations(request: HttpRequest) -> HttpResponse:
    """All explorations, newest first."""
    return render(request, "dashboard/explorations.html", {"explorations": searches.explorations()})


@page
def exploration(request: HttpRequest, key: int) -> HttpResponse:
    """An exploration: progress, results, and all evaluations. A preparation is part of its front's page."""
    seen = or_404(watch(key))
    if seen.exploration.prepares is not None:
        return redirect("dashboard:front", seen.exploration.prepares.slug)
    return render(request, "dashboard/exploration.html", _shown(request, seen))


@page
def exploration_live(request: HttpRequest, key: int) -> HttpResponseBase:
    """The part of the page of an exploration that changes while it runs; 304 if the caller has it."""
    seen = or_404(watch(key))
    return respond_with_etag(
        request,
        _version(request, seen),
        lambda: render(request, "dashboard/exploration_live.html", _shown(request, seen)),
    )


def _shown(request: HttpRequest, seen: ExplorationStatus) -> dict[str, Any]:
    have = watching.results_of(seen)
    evaluations = (
        seen.exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number").only(*SHOWN)
    )
    learnt = milestone(len(have.indices))
    again = measured_again(seen.exploration, have)
    part = Paginator(evaluations, EVALUATIONS).get_page(request.GET.get("page"))
    named = {name for row in part for name in row.objectives or ()}
    return {
        "seen": seen,
        "version": _version(request, seen),
        "staff": _staff(request),
        "have": have,
        "exploration": seen.exploration,
        "outcome": outcome_of(seen),
        "limit": ate_limit(seen.exploration),
        "bars": _bars(have),
        "part": part,
        "tails": {name: name in named for name in TAILS},
        "learnt": learnt,
        "learns_from": LEAST,
        "again": again,
        # Figures of an open page are replaced when this value changes.
        "kind": f"{bool(have.points)} {bool(have.indices)} {bool(learnt)} {bool(again)}",
        "importance_height": importance_height(len(seen.exploration.space["parameters"])),
        "now": timezone.now(),
    }


def _bars(have: SearchResults) -> ParameterBars:
    usual = default_point(have.points)
    return parameter_bars(
        [_row(point) for point in spread(have.front, LISTED)],
        usual.configuration if usual else None,
    )


def _row(point: Point) -> Row:
    return Row(
        name=formats.configuration(point.label, point.number),
        runtime=point.values.get("runtime"),
        ate_max=point.values.get("ate_max"),
        parameters=point.configuration,
        measurements=point.measurements,
    )


def _version(request: HttpRequest, seen: ExplorationStatus) -> str:
    """The version of the live part of the page. Staff see more, so their version differs."""
    return f"{seen.version}-staff" if _staff(request) else seen.version


def _staff(request: HttpRequest) -> bool:
    return request.user.is_authenticated and request.user.is_staff
