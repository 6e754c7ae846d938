"""The home page."""

from dataclasses import replace
from typing import Any

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.drawings.speedups import colour_of
from crowd.dashboard.figures.speedups import bars_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.dashboard.race import race
from crowd.fronts import selectors as published
from crowd.results.reading import selectors as results
from crowd.results.reading.filters import quoted
from crowd.results.reading.rows import Share
from crowd.results.reading.selectors import Speedups

NEWEST = 6
# What the crowd is broken down by, and what a page calls it.
PARTS = {"vendor": "chip that computed", "soc": "system on a chip", "os": "operating system"}


@filtered
def home(request: HttpRequest, asked: Filtering) -> HttpResponse:
    """The crowd's answer: how many devices, how much faster, and how to add one's own."""
    crowd = results.speedups(asked.filters)
    front = published.front(crowd.front) if crowd.front else None
    return render(
        request,
        "dashboard/home.html",
        {
            "asked": asked,
            "colour": colour_of(request),
            "crowd": crowd,
            "front": front,
            "protocol": front.protocol if front else {},
            "lanes": race(crowd.headline.geometric_mean, asked.filters.leading),
            "breakdowns": [(by, name, _linked(crowd, by)) for by, name in PARTS.items()],
            "sessions": results.latest_sessions(NEWEST, asked.filters.simulated, crowd.front),
            "height": bars_height(len(crowd.rows)),
        },
    )


def _linked(crowd: Speedups, by: str) -> list[tuple[Share, str]]:
    """Each group of CROWD by something, with the query that asks for it under the same filters."""

    def query(group: str) -> str:
        change: dict[str, Any] = {by: group if by == "vendor" else quoted(group)}
        return replace(crowd.filters, **change).query()

    return [(share, query(share.group)) for share in crowd.parts[by]]
