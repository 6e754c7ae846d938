"""Fronts: the list, one of them beside another."""

from dataclasses import replace

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.answering import found, page
from crowd.dashboard.choosing import named
from crowd.dashboard.figures.parameters import parameters_height
from crowd.dashboard.figures.transfer import winners_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.dashboard.points import measured_points, parameters_of, results_by_sequence
from crowd.dashboard.versions import UnknownVersionError, beside
from crowd.fronts import selectors as published
from crowd.fronts.content.generalisation import FACTOR, MARGIN
from crowd.results.reading import selectors as results
from crowd.results.reading.filters import ALL


@page
def fronts(request: HttpRequest) -> HttpResponse:
    """Every published front, newest first."""
    return render(request, "dashboard/fronts.html", {"fronts": published.fronts()})


@filtered
def front(request: HttpRequest, asked: Filtering, slug: str) -> HttpResponse:
    """One front: its points as predicted and as the crowd under filters measures them, and the difference
    from another version.
    """
    asked, shown = asked.within, found(published.front(slug))
    others = [version for version in published.fronts(shown.application) if version.slug != slug]
    problem = ""
    try:
        difference = beside(shown, others, request.GET.get("against", ""))
    except UnknownVersionError as error:
        difference, problem = beside(shown, others, ""), str(error)
    filters = replace(asked.filters, front=slug, application=shown.application)
    crowd = results.speedups(replace(filters, configuration=ALL))
    winners = results.winners(filters)
    columns, rows = results_by_sequence(shown)
    return render(
        request,
        "dashboard/front.html",
        {
            "asked": asked,
            "front": shown,
            "points": measured_points(shown, crowd),
            "factor": FACTOR,
            "margin": MARGIN,
            "sequences": columns,
            "sequence_rows": rows if columns else (),
            "devices": crowd.headline.devices,
            "parameters": parameters_of(shown),
            "parameters_height": parameters_height(len(parameters_of(shown))),
            "found": winners,
            "winners_height": winners_height(len(winners.counts)),
            "query": filters.query(),
            "named": named(shown.application),
            "versions": others,
            "difference": difference,
            "problem": problem,
        },
        status=400 if problem else 200,
    )
