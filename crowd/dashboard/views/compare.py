"""Comparisons of devices, configurations, two backends, two sessions, two fronts, or two periods."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date, timedelta
from typing import Any
from urllib.parse import urlencode
from uuid import UUID

from django.http import HttpRequest, HttpResponse, HttpResponseBase, HttpResponseRedirect
from django.shortcuts import render
from django.urls import reverse

from crowd.dashboard.comparing import differences
from crowd.dashboard.comparing.application_choice import measured_device, next_query
from crowd.dashboard.comparing.comparison import Comparison, InvalidComparisonError, parse_names
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.drawings.comparison import read
from crowd.dashboard.figures.frames import stages_height
from crowd.dashboard.responses import or_404, page
from crowd.devices.naming.spelling import words
from crowd.fronts import selectors as published
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.records.device import Device
from crowd.records.measured_device import DeviceRow
from crowd.records.speedup import Speedup
from crowd.records.uncertainty import Estimate
from crowd.results.reading import selectors as results
from crowd.results.reading.backends import BACKENDS, BackendRow, preference
from crowd.results.reading.frame_times import log_times
from crowd.results.reading.queries.filters import InvalidFilterError, SpeedupFilters
from wire.front import BEST, DEFAULT

UUID_TEXT = re.compile(r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.IGNORECASE)
OFFERED = 8  # devices offered for an ambiguous name, and newest sessions
LISTED = 20  # listed devices with the largest changes, up and down


@page
def compare(request: HttpRequest) -> HttpResponseBase:
    """The comparison that the query string names, otherwise a form for each kind of comparison."""
    # A form also sends its empty fields, and the last of several equal fields may be empty.
    given = {name for name, values in request.GET.lists() if any(values)}
    try:
        if "sessions" in given:
            return _sessions(request)
        if "fronts" in given:
            return _fronts(request)
        if "date" in given:
            return _periods(request)
        if "backends" in given:
            return _backends(request)
        if given & {"devices", "configurations", "device"}:
            return _devices(request)
        if given & {"first", "second"}:
            return _typed(request)
    except (InvalidComparisonError, InvalidFilterError) as error:
        return _chooser(request, problem=str(error))
    return _chooser(request)


def _devices(request: HttpRequest) -> HttpResponse:
    shown = read(request)
    return render(
        request,
        "dashboard/compare.html",
        {
            "shown": shown,
            "query": shown.query,
            "next_query": next_query(shown.application, published.names()),
            "choices": [(name, f"?{shown.with_application(name)}") for name in shown.applications],
            "runs": sum(row.runs for row in shown.bars),
            "height": stages_height(len(shown.bars)),
            "differences": _between_devices(shown),
        },
    )


def _between_devices(shown: Comparison) -> list[differences.Difference]:
    if not shown.figures:
        return []
    times = [log_times(figure) for figure in shown.figures]
    names = [figure.device.title for figure in shown.figures]
    return differences.between_figures(names, shown.figures, times)


def _backends(request: HttpRequest) -> HttpResponse:
    """Compare two backends on one device: ?device=a&backends=opencl,webgpu."""
    names = parse_names(request.GET.getlist("backends"), "backends", most=2)
    shown = measured_device(request.GET.get("device", ""), request.GET.get("application", ""))
    figure = newest_figure(shown.detail)
    front = figure.front if figure else ""
    rows = results.backend_comparison(shown.detail.device.slug, shown.detail.speedups, front)
    by_name = {row.figure.backend: row for row in rows}
    if missing := [name for name in names if name not in by_name]:
        choices = ", ".join(by_name) or "none: only one backend has measured it"
        raise InvalidComparisonError(
            f"{shown.detail.device.title} has no figure with {missing[0]:.50}: choose two of {choices}"
        )
    figures = [by_name[name].figure for name in names]
    times = [log_times(figure) for figure in figures]
    return render(
        request,
        "dashboard/compared_backends.html",
        {
            "device": shown.detail.device,
            "next_query": shown.next_query,
            "figure": figure,
            "backends": [
                BackendRow(figure, _seconds(each, DEFAULT), _seconds(each, BEST))
                for figure, each in zip(figures, times, strict=True)
            ],
            "differences": differences.between_figures([BACKENDS[name] for name in names], figures, times),
        },
    )


def _seconds(times: dict[str, Estimate], configuration: str) -> float | None:
    """The mean of `times` (log microseconds) of `configuration`."""
    return math.exp(times[configuration].log) * 1e-6 if configuration in times else None


def _sessions(request: HttpRequest) -> HttpResponse:
    """Compare two sessions, given by identifiers or by the addresses of their pages."""
    given = [text for value in request.GET.getlist("sessions") for text in value.split(",") if text.strip()]
    uuids = list(dict.fromkeys(UUID(match) for text in given for match in UUID_TEXT.findall(text)))
    if len(uuids) != 2:
        raise InvalidComparisonError(f"tick two sessions, or give two addresses; these are {len(uuids)}")
    one, other = (or_404(results.session(uuid)) for uuid in uuids)
    if one.session.front != other.session.front:
        raise InvalidComparisonError(
            f"the sessions measured different fronts, {one.session.front} and {other.session.front}: "
            "choose two of one front"
        )
    return render(
        request,
        "dashboard/compared_sessions.html",
        {
            "sessions": [one.session, other.session],
            "differences": differences.between_sessions(one, other),
        },
    )


def _fronts(request: HttpRequest) -> HttpResponse:
    """Compare the best configurations of two fronts, on devices that measured both."""
    slugs = parse_names(request.GET.getlist("fronts"), "fronts", most=2)
    applications = dict(published.names())
    for slug in slugs:
        if slug not in applications:
            raise InvalidComparisonError(
                f"there is no front {slug:.100}: choose from {', '.join(applications)}"
            )
    if len({applications[slug] for slug in slugs}) > 1:
        raise InvalidComparisonError("the fronts are of different applications: choose two of one")
    new, old = (
        results.speedups(SpeedupFilters(front=slug, application=applications[slug])) for slug in slugs
    )
    both = differences.pairs(new.rows, old.rows)
    names = [f"best of {slug}" for slug in slugs]
    shown = differences.over_pairs(both, f"Best of {slugs[0]}", names[1], differences.FASTER, "")
    return _crowds(request, both, shown, "Two fronts", slugs)


def _periods(request: HttpRequest) -> HttpResponse:
    """Compare speedups before and after a day, with the other filters."""
    try:
        day = date.fromisoformat(request.GET["date"])
    except ValueError:
        raise InvalidFilterError(
            "date", f"date={request.GET['date']:.50}: give a day as 2026-11-30"
        ) from None
    filters = replace(results.parse_filters(request.GET), since=None, until=None)
    if day == date.min:
        raise InvalidFilterError("date", f"date={day}: give a later day")
    after = results.speedups(replace(filters, since=day))
    before = results.speedups(replace(filters, until=day - timedelta(days=1)))
    both = differences.pairs(after.rows, before.rows)
    names = (f"since {day}", f"before {day}")
    shown = differences.over_pairs(
        both, f"What was measured {names[0]}", f"what was measured {names[1]}", differences.GAINS, ""
    )
    return _crowds(request, both, shown, f"Before and after {day}", names)


def _crowds(
    request: HttpRequest,
    both: list[differences.Pair],
    shown: differences.Difference | None,
    title: str,
    names: tuple[str, ...],
) -> HttpResponse:
    return render(
        request,
        "dashboard/compared_crowds.html",
        {
            "title": title,
            "names": names,
            # On a phone: since and before, without the day.
            "labels": [name.split()[0] for name in names],
            "pairs": both if len(both) <= 2 * LISTED else [*both[:LISTED], *both[-LISTED:]],
            "devices": len(both),
            "differences": [shown] if shown else [],
        },
    )


@dataclass(frozen=True)
class Typed:
    """The text of a field, and the devices that it may mean."""

    name: str
    text: str
    devices: tuple[DeviceRow, ...]

    @property
    def slug(self) -> str:
        """The only matching device by address, by all words of the name, or at all; "" otherwise."""
        typed = set(words(self.text))
        by_address = [row for row in self.devices if self.text == row.device.slug]
        by_name = [row for row in self.devices if typed <= set(words(row.device.title))]
        chosen = by_address or by_name or self.devices
        return chosen[0].device.slug if len(chosen) == 1 else ""


def _typed(request: HttpRequest) -> HttpResponseBase:
    """Redirect to the comparison of two named devices, or offer choices for ambiguous names."""
    fields = [_field(request.GET, name) for name in ("first", "second")]
    slugs = [field.slug for field in fields]
    if all(slugs) and slugs[0] != slugs[1]:
        query = urlencode({"devices": ",".join(slugs)}, safe=",")
        return HttpResponseRedirect(f"{reverse('dashboard:compare')}?{query}")
    unknown = [field.text for field in fields if field.text and not field.devices]
    problem = f"no measured device fits {' and '.join(unknown):.200}" if unknown else ""
    if all(slugs):
        problem = f"both names mean {slugs[0]}: name another device"
    return _chooser(request, fields, problem=problem, status=200)


def _field(asked: Mapping[str, str], name: str) -> Typed:
    text = " ".join(asked.get(name, "").split())[:100]
    return Typed(name, text, results.search(text).devices if text else ())


def _with_several_backends() -> list[tuple[Device, list[str]]]:
    """Devices with figures of best by several backends, and two of these. First those where both rest on
    many independent installations.
    """
    figures: dict[str, dict[str, Speedup]] = {}
    for row in sorted(results.speedups(SpeedupFilters()).rows, key=preference):
        figures.setdefault(row.device.slug, {}).setdefault(row.backend, row)
    pairs = [list(by_backend.values())[:2] for by_backend in figures.values() if len(by_backend) > 1]
    pairs.sort(key=lambda pair: -min(row.units for row in pair))
    return [(pair[0].device, [row.backend for row in pair]) for pair in pairs]


def _chooser(
    request: HttpRequest, fields: list[Typed] | None = None, problem: str = "", status: int | None = None
) -> HttpResponse:
    names = published.names()
    context: dict[str, Any] = {
        "problem": problem,
        "fields": fields or [Typed(name, "", ()) for name in ("first", "second")],
        "offered": OFFERED,
        "fronts": names if len(names) > 1 else (),
        "sessions": results.latest_by_device(OFFERED),
        "several": _with_several_backends(),
        "several_of": DEFAULT_APPLICATION,
    }
    return render(
        request, "dashboard/compare_chooser.html", context, status=status or (400 if problem else 200)
    )
