"""Pictures that links are shown with, drawn from the same rows as their pages."""

import hashlib

from django.core.cache import cache
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from django.views.decorators.http import require_safe

from crowd.dashboard import formats
from crowd.dashboard.figures.card import Card, png
from crowd.dashboard.filtering import Filtering
from crowd.dashboard.points import newest_figure
from crowd.dashboard.views.page import found
from crowd.results import selectors as results
from crowd.results.filters import SpeedupFilters
from crowd.results.rows import DeviceDetail, Headline, Speedups

KEPT_SECONDS = 600
SIMULATED = "Simulated, not measured. "


@require_safe
def crowd_card(request: HttpRequest) -> HttpResponseBase:
    """The crowd's headline and bars, under the filters of the query string."""
    return _picture(request, of_crowd(results.speedups(Filtering.of(request).filters)))


@require_safe
def device_card(request: HttpRequest, slug: str) -> HttpResponseBase:
    """A device's speedup, and its place among all."""
    detail = found(results.device(slug))
    return _picture(request, of_device(detail, results.speedups(_around(detail))))


def of_crowd(crowd: Speedups) -> Card:
    """What a link to the crowd under filters shows."""
    line = crowd.headline
    label = SIMULATED if crowd.filters.simulated else ""
    if line.geometric_mean is None:
        return Card("Tuned on one machine.", "How fast on yours?", f"{label}No device has been measured yet.")
    words = "on one device" if line.devices == 1 else f"across {line.devices:,} devices"
    return Card(
        title=f"Tuned on one machine, faster {words}",
        figure=formats.speedup(line.geometric_mean),
        note=label + _certainty(line),
        bars=tuple(row.speedup for row in crowd.rows),
    )


def of_device(detail: DeviceDetail, crowd: Speedups) -> Card:
    """What a link to a device shows; its bar is lit among those of CROWD."""
    device, figure = detail.device, newest_figure(detail)
    label = SIMULATED if device.simulated else ""
    if figure is None:
        return Card(device.title, "not measured yet", f"{label}No session of it counts so far.")
    keys = [row.key for row in crowd.rows]
    sessions = formats.plural(figure.sessions, "session")
    interval = (
        f", 95 % interval {formats.interval(figure.low, figure.high)}" if figure.low is not None else ""
    )
    return Card(
        title=device.title,
        figure=f"{formats.speedup(figure.speedup)} faster",
        note=f"{label}Best over default configuration, {sessions}{interval}",
        bars=tuple(row.speedup for row in crowd.rows) if figure.key in keys else (),
        lit=keys.index(figure.key) if figure.key in keys else None,
    )


def _around(detail: DeviceDetail) -> SpeedupFilters:
    """The crowd that a device is shown in: of its own front, and of its own kind."""
    figure = newest_figure(detail)
    return SpeedupFilters(front=figure.front if figure else "", simulated=detail.device.simulated)


def _certainty(line: Headline) -> str:
    words = f"Geometric mean, {formats.plural(line.sessions, 'session')}"
    return words if line.low is None else f"{words}, 95 % interval {formats.interval(line.low, line.high)}"


def _picture(request: HttpRequest, card: Card) -> HttpResponseBase:
    digest = hashlib.sha256(repr(card).encode()).hexdigest()[:32]
    etag = quote_etag(digest)
    if (unchanged := get_conditional_response(request, etag=etag)) is not None:
        return unchanged
    body = cache.get_or_set(f"card-{digest}", lambda: png(card), KEPT_SECONDS)
    response = HttpResponse(body, content_type="image/png")
    response["ETag"] = etag
    response["Cache-Control"] = f"public, max-age={KEPT_SECONDS}"
    return response
