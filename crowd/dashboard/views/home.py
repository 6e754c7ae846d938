"""The home page."""

from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.urls import reverse

from crowd.dashboard.content.confirmation import left_out
from crowd.dashboard.drawings.drawing import with_query
from crowd.dashboard.drawings.speedups import Bars
from crowd.dashboard.figures.speedups import VENDOR
from crowd.dashboard.filtering import Filtering, filtered
from crowd.fronts import selectors as published
from crowd.results.reading import selectors as results

NEWEST = 5
ROWS = 10


@filtered
def home(request: HttpRequest, asked: Filtering) -> HttpResponse:
    """The home page: how much faster the crowd gets, its bars, and how to take part.

    The list of devices has filters: an address with some leads there.
    """
    if asked.filtered:
        return HttpResponseRedirect(with_query(reverse("dashboard:devices"), asked.query))
    crowd = results.speedups(asked.filters)
    bars = Bars.of(crowd, VENDOR)
    front = published.front(crowd.front) if crowd.front else None
    return render(
        request,
        "dashboard/home.html",
        {
            "asked": asked,
            "crowd": crowd,
            "bars": bars,
            "listed": bars.rows[:ROWS],
            "others": left_out(crowd),
            "front": front,
            "protocol": front.protocol if front else None,
            "sessions": results.latest_by_device(NEWEST, crowd.front),
        },
    )
