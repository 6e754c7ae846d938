"""Explorations: the list, one of them, and the part of it that changes while it runs."""

from typing import Any

from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import render
from django.utils import timezone

from crowd.dashboard.answering import found, page, tagged
from crowd.dashboard.searches import ate_limit, yield_of
from crowd.explorations import selectors as searches
from crowd.explorations.models import Evaluation
from crowd.explorations.outcomes import watching
from crowd.explorations.outcomes.insights import milestone
from crowd.explorations.outcomes.watching import Watch, watch

EVALUATIONS = 50


@page
def explorations(request: HttpRequest) -> HttpResponse:
    """Every search, newest first."""
    return render(request, "dashboard/explorations.html", {"explorations": searches.explorations()})


@page
def exploration(request: HttpRequest, key: int) -> HttpResponse:
    """One search: how far it is, what it found, and every evaluation."""
    return render(request, "dashboard/exploration.html", _shown(request, found(watch(key))))


@page
def exploration_live(request: HttpRequest, key: int) -> HttpResponseBase:
    """The part of an exploration's page that changes while it runs; 304 where the caller has it."""
    seen = found(watch(key))
    return tagged(
        request,
        _version(request, seen),
        lambda: render(request, "dashboard/exploration_live.html", _shown(request, seen)),
    )


def _shown(request: HttpRequest, seen: Watch) -> dict[str, Any]:
    have = watching.found(seen)
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
