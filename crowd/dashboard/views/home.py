"""The home page."""

from dataclasses import dataclass, replace
from typing import Any

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.content.confirmation import LeftOut, confirmed_first, left_out
from crowd.dashboard.content.race import race
from crowd.dashboard.drawings.speedups import colour_of, finding_of
from crowd.dashboard.figures.speedups import bars_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.fronts import selectors as published
from crowd.results.reading import selectors as results
from crowd.results.reading.queries.filters import exact_filter
from crowd.results.reading.rows import BreakdownRow, ModelOutcomes
from crowd.results.reading.selectors import Speedups

NEWEST = 5
# Criteria of the breakdowns, with their names on the page.
PARTS = {
    "vendor": "chip maker",
    "backend": "backend",
    "soc": "SoC",
    "os": "system",
}
NO_OUTCOMES = ModelOutcomes(devices=0, failing=0, losing=0)
EXACT = frozenset({"vendor", "backend"})  # filters that match whole names


@filtered
def home(request: HttpRequest, asked: Filtering) -> HttpResponse:
    """The home page: the headline of the crowd, its bars and breakdowns, and how to take part."""
    crowd = results.speedups(asked.filters)
    front = published.front(crowd.front) if crowd.front else None
    others = left_out(crowd)
    return render(
        request,
        "dashboard/home.html",
        {
            "asked": asked,
            "colour": colour_of(request),
            "crowd": crowd,
            "finding": finding_of(crowd),
            "rows": confirmed_first(crowd.rows),
            "others": others,
            "front": front,
            "protocol": front.protocol if front else {},
            "lanes": race(_raced(crowd, others), asked.filters.headline_configuration),
            "breakdowns": [(by, name, _parts(crowd, by)) for by, name in PARTS.items()],
            "sessions": results.latest_sessions(NEWEST, crowd.front),
            "height": bars_height(len(crowd.rows)),
            "emptied_by": () if crowd.rows or not asked.filtered else asked.emptied_by(),
        },
    )


def _raced(crowd: Speedups, others: LeftOut) -> float | None:
    """The speedup of the race: the mean, or that of the only device."""
    if crowd.headline.devices:
        return crowd.headline.mean
    return others.only.speedup if others.only else None


@dataclass(frozen=True)
class Part:
    """A group of the crowd, its attempts, and the query for it with the same filters."""

    share: BreakdownRow
    attempts: ModelOutcomes
    query: str


def _parts(crowd: Speedups, by: str) -> list[Part]:
    """The groups of `crowd` by one of PARTS that have a counted figure."""

    def query(group: str) -> str:
        change: dict[str, Any] = {by: group if by in EXACT else exact_filter(group)}
        return replace(crowd.filters, **change).query()

    return [
        Part(
            share,
            crowd.outcome_breakdowns[by].get(share.group, NO_OUTCOMES),
            query(share.group),
        )
        for share in crowd.breakdowns[by]
        if share.figure.devices
    ]
