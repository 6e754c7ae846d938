"""The home page."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.figures.speedups import bars_height
from crowd.dashboard.race import race
from crowd.dashboard.views.page import page
from crowd.fronts import selectors as published
from crowd.results import selectors as results
from crowd.results.filters import SpeedupFilters

NEWEST = 6


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
