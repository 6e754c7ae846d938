"""Fronts: the list, one of them beside another."""

from dataclasses import replace

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.figures.parameters import parameters_height
from crowd.dashboard.figures.transfer import winners_height
from crowd.dashboard.points import measured_points, parameters_of
from crowd.dashboard.versions import UnknownVersionError, beside
from crowd.dashboard.views.page import found, page
from crowd.fronts import selectors as published
from crowd.results import selectors as results
from crowd.results.filters import ALL, SpeedupFilters


@page
def fronts(request: HttpRequest) -> HttpResponse:
    """Every published front, newest first."""
    return render(request, "dashboard/fronts.html", {"fronts": published.fronts()})


@page
def front(request: HttpRequest, slug: str) -> HttpResponse:
    """One front: its points as predicted and as the crowd measures them, and what another version had."""
    shown = found(published.front(slug))
    others = [version for version in published.fronts(shown.application) if version.slug != slug]
    problem = ""
    try:
        difference = beside(shown, others, request.GET.get("against", ""))
    except UnknownVersionError as error:
        difference, problem = beside(shown, others, ""), str(error)
    filters = SpeedupFilters(front=slug, application=shown.application)
    crowd = results.speedups(replace(filters, configuration=ALL))
    winners = results.winners(filters)
    return render(
        request,
        "dashboard/front.html",
        {
            "front": shown,
            "points": measured_points(shown, crowd.rows),
            "parameters": parameters_of(shown),
            "parameters_height": parameters_height(len(parameters_of(shown))),
            "found": winners,
            "winners_height": winners_height(len(winners.counts)),
            "query": filters.query(),
            "others": others,
            "difference": difference,
            "problem": problem,
        },
        status=400 if problem else 200,
    )
