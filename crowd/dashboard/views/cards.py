"""Preview pictures of links, from the same rows as the pages."""

from collections.abc import Callable
from dataclasses import replace

from django.http import HttpRequest, HttpResponseBase
from django.views.decorators.http import require_safe

from crowd.dashboard import formats
from crowd.dashboard.comparing.application_choice import application_query, measured_device
from crowd.dashboard.content.citation import SIMULATED
from crowd.dashboard.content.confirmation import confirmed_only, left_out, private_notice, requirement
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.drawings.serving import explain_errors
from crowd.dashboard.figures.card import Card, png
from crowd.dashboard.responses import cached, conditional_response
from crowd.demo.mark import is_demo
from crowd.devices import revision
from crowd.fronts import selectors as published
from crowd.results.reading import selectors as results
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import DeviceDetail, Headline
from crowd.results.reading.selectors import Speedups
from wire.front import BEST


@require_safe
@explain_errors
def crowd_card(request: HttpRequest) -> HttpResponseBase:
    """The headline and bars of the crowd, with the filters of the query string."""
    filters = results.parse_filters(request.GET, published.names())
    # The revision of figures does not change when a front is published or retired.
    front = results.measured_front(filters.application)
    return _picture(request, (filters.query(), front), lambda: of_crowd(results.speedups(filters)))


@require_safe
def device_card(request: HttpRequest, slug: str) -> HttpResponseBase:
    """The speedup of a device with the application of the query string, and its place in the crowd."""
    application = request.GET.get("application", "")

    def read() -> Card:
        shown = measured_device(slug, application)
        scope = formats.application(shown.application) if application_query(shown) else ""
        return replace(of_device(shown.detail, results.speedups(_around(shown.detail))), scope=scope)

    return _picture(request, (slug, application), read)


def of_crowd(crowd: Speedups) -> Card:
    """The card of the crowd under filters: counted figures, and the number of others."""
    line, others = crowd.headline, left_out(crowd)
    filters, scope = crowd.filters, crowd.filters.describe()
    label = _label()
    if line.mean is None:
        if others.devices:
            words = f"Measured so far: {others.words}. {requirement().capitalize()}."
        else:
            words = "No device matches these filters." if scope else "No device has been measured yet."
        return Card("Tuned on one machine.", "How fast on yours?", f"{label}{words}", scope=scope)
    words = "on one device" if line.devices == 1 else f"across {line.devices:,} devices"
    start = (
        "Tuned on one machine,"
        if filters.headline_configuration == BEST
        else f"Configuration {filters.headline_configuration} over default,"
    )
    missing = f". Not in it: {others.words}" if others.devices else ""
    return Card(
        title=f"{start} {words}",
        figure=formats.gain(line.mean, line.range),
        note=f"{label}{_certainty(line)}{missing}. {private_notice()}".removesuffix(". "),
        scope=scope,
        bars=tuple(row.speedup for row in confirmed_only(crowd.rows)),
    )


def of_device(detail: DeviceDetail, crowd: Speedups) -> Card:
    """The card of a device, with its bar highlighted among the counted ones of `crowd`.

    An uncounted figure is not shown.
    """
    device, figure = detail.device, newest_figure(detail)
    label = _label()
    if figure is None:
        return Card(device.title, "not measured yet", f"{label}No session of it counts so far.")
    sessions = formats.plural(figure.sessions, "session")
    if not figure.counts:
        state = "suspect" if figure.suspect else "not confirmed yet"
        reason = "No session of it is valid." if figure.suspect else f"{requirement().capitalize()}."
        return Card(device.title, state, f"{label}Measured in {sessions}. {reason}")
    rows = confirmed_only(crowd.rows)
    keys = [] if figure.range else [row.key for row in rows]
    interval = (
        f", 95 % interval {formats.interval(figure.low, figure.high)}" if figure.low is not None else ""
    )
    return Card(
        title=device.title,
        figure=formats.gain(figure.speedup, figure.range),
        note=f"{label}Best over default configuration, {sessions}{interval}",
        bars=tuple(row.speedup for row in rows) if figure.key in keys else (),
        lit=keys.index(figure.key) if figure.key in keys else None,
    )


def _around(detail: DeviceDetail) -> SpeedupFilters:
    """The filters of the crowd that a device is compared with: same front."""
    figure = newest_figure(detail)
    return SpeedupFilters(front=figure.front if figure else "")


def _label() -> str:
    return f"{SIMULATED}. " if is_demo() else ""


def _certainty(line: Headline) -> str:
    words = f"Mean, {formats.plural(line.sessions, 'session')}"
    return words if line.low is None else f"{words}, 95 % interval {formats.interval(line.low, line.high)}"


def _picture(request: HttpRequest, key: object, read: Callable[[], Card]) -> HttpResponseBase:
    """The picture of the card that `read` returns, cached under `key` while no figure changes."""
    facts = (request.path, key, revision.current())
    return conditional_response(request, cached(facts, lambda: png(read())), "image/png")
