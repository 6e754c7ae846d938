"""The list of devices, and the page of a device."""

from dataclasses import replace
from typing import Any, NamedTuple
from urllib.parse import urlencode

from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.comparing.application_choice import (
    application_option,
    application_query,
    measured_device,
)
from crowd.dashboard.content.advice import Advice, Limits, for_device
from crowd.dashboard.content.confirmation import confirmed_by_chip, left_out
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.content.race import race
from crowd.dashboard.content.ranking import ConfigurationRanking, rank_configurations
from crowd.dashboard.drawings.devices import Rank, attempts_of, crowd_of, finding_of, rank_of
from crowd.dashboard.drawings.groups import CRITERIA, Breakdown
from crowd.dashboard.drawings.speedups import Bars, colour_of
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.devices import configurations_height, releases_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.dashboard.responses import page
from crowd.dashboard.views.sessions import of_session
from crowd.predictions.selectors import NothingConfirmedError
from crowd.records.measured_device import DeviceRow
from crowd.results.reading import selectors as results
from crowd.results.reading.queries.filters import InvalidFilterError, exact_filter
from crowd.results.reading.rows import Headline, History, ModelOutcomes
from crowd.results.reading.selectors import Speedups

PAGE = 40
EXACT = frozenset({"vendor", "backend"})  # filters that match whole names


@filtered
def devices(request: HttpRequest, asked: Filtering) -> HttpResponse:
    """All measured devices, with the filters of the query string."""
    crowd = results.speedups(asked.filters)
    rows = asked.order.sort(crowd.rows)
    pages = Paginator(rows, max(len(rows), 1) if asked.all_rows else PAGE)
    return render(
        request,
        "dashboard/devices.html",
        {
            "asked": asked,
            "colour": colour_of(request),
            "crowd": crowd,
            "rows": rows,
            "others": left_out(crowd),
            "part": pages.get_page(request.GET.get("page")),
            "bars": Bars.of(crowd, colour_of(request)),
            "breakdowns": [(by, name, _parts(Breakdown(crowd, by))) for by, name in CRITERIA.items()],
            "emptied_by": () if crowd.rows or not asked.filtered else asked.emptied_by(),
            "query": asked.table_query,
            "pending": () if asked.filtered else _without_figure(crowd),
        },
    )


def _without_figure(crowd: Speedups) -> list[tuple[DeviceRow, tuple[int, int, int]]]:
    """The devices without a figure, each with its sessions, the failed and the lost ones."""
    rows = results.devices_without_figure(crowd.filters.application, crowd.front)
    return [(row, attempts_of(crowd, row.device.slug, None)) for row in rows]


class Part(NamedTuple):
    """A group of the crowd: its name, its figure, how its devices fared, and the query that shows it."""

    name: str
    figure: Headline
    attempts: ModelOutcomes
    query: str


def _parts(shown: Breakdown) -> list[Part]:
    def query(group: str) -> str:
        change: dict[str, Any] = {shown.by: group if shown.by in EXACT else exact_filter(group)}
        return replace(shown.crowd.filters, **change).query()

    return [
        Part(shown.name(row.group), row.figure, shown.outcomes(row.group), query(row.group))
        for row in shown.rows
    ]


@page
def device(request: HttpRequest, slug: str) -> HttpResponse:
    """A device with one application: speedup, place in the crowd, configurations, sessions, history."""
    shown = measured_device(slug, request.GET.get("application", ""))
    detail = shown.detail
    figure = newest_figure(detail)
    crowd = crowd_of(detail, figure)
    here = rank_configurations(detail, figure)
    # What follows from one session has no number where its interval is wide.
    wide = figure.range if figure else None
    history = None if wide else results.history(slug, application=shown.application)
    try:
        prediction, unconfirmed = for_device(figure), ""
    except NothingConfirmedError as error:
        prediction, unconfirmed = None, str(error)
    if wide:
        prediction, unconfirmed = None, "the interval of its only session is too wide"
    try:
        limits, problem = Limits.of(request.GET), ""
    except InvalidFilterError as error:
        limits, problem = Limits(), str(error)
    rank = None if wide else rank_of(crowd, slug)
    shown_session = of_session(detail.latest)
    front_query = {"application": shown.application} if application_query(shown) else {}
    return render(
        request,
        "dashboard/device.html",
        {
            "application": shown.application,
            "choices": [(name, f"?application={name}") for name in shown.applications],
            "query": application_query(shown),
            "next_query": shown.next_query,
            "application_option": application_option(shown.application),
            "detail": detail,
            "device": detail.device,
            "protocol": detail.latest.protocol if detail.latest else None,
            "figure": figure,
            "by_chip": confirmed_by_chip(figure),
            "lanes": race(figure.speedup if figure and not wide else None),
            "rank": rank,
            "fared": attempts_of(crowd, slug, figure),
            "ranking": here,
            "advice": Advice.of(prediction, limits) if prediction else None,
            "nothing_confirmed": unconfirmed,
            "advice_query": urlencode(front_query | limits.parameters()),
            "problem": problem,
            "configurations_height": configurations_height(len(here.rows) if here else 0),
            "others": [row for row in detail.speedups if here is None or row not in here.rows],
            "backends": results.backend_comparison(slug, detail.speedups, figure.front) if figure else (),
            "history": history,
            "releases_height": releases_height(len(history.releases) if history else 0),
            **shown_session,
            "findings": shown_session["findings"] | _findings(rank, here, history),
            "newest": results.newest_times(detail, figure) if figure else None,
        },
        status=400 if problem else 200,
    )


def _findings(
    rank: Rank | None, here: ConfigurationRanking | None, history: History | None
) -> dict[str, str]:
    """The titles of the charts, except those of a session."""
    titles = {"releases": findings.releases(history)}
    if rank:
        titles["place"] = findings.place(rank.place, rank.confirmed)
    if here:
        titles["configurations"] = finding_of(here)
    return titles
