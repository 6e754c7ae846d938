"""Figures as JSON with an ETag, for the script that draws them. Each view reads one selector and draws
one figure.
"""

import hashlib
from collections.abc import Callable
from typing import TypeVar
from uuid import UUID

from django.core.cache import cache
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe
from plotly import graph_objects as go

from crowd.dashboard.comparison import InvalidComparisonError, compared, labelled, parse_devices
from crowd.dashboard.figures.explorations import (
    exploration_plane,
    hypervolume_line,
    importance_bars,
    prediction_plane,
)
from crowd.dashboard.figures.frames import frame_lines, stage_areas, stage_bars
from crowd.dashboard.figures.fronts import front_plane
from crowd.dashboard.figures.speedups import speedup_bars
from crowd.dashboard.palette import LIGHT, THEMES, Theme
from crowd.dashboard.protocols import first_counted_frame, max_ate
from crowd.dashboard.searches import ate_limit, growth_of
from crowd.dashboard.stages import stage_times
from crowd.explorations import software
from crowd.explorations.insights import insight
from crowd.explorations.watching import Watch, found, watch
from crowd.fronts import selectors as published
from crowd.results import selectors as results
from crowd.results.filters import InvalidFilterError, SpeedupFilters

Row = TypeVar("Row")
KEPT_SECONDS = 60


@gzip_page
@require_safe
def speedups(request: HttpRequest) -> HttpResponseBase:
    """One bar a device, under the filters of the query string."""
    try:
        filters = SpeedupFilters.parse(request.GET)
    except InvalidFilterError as error:
        return HttpResponse(str(error), status=400, content_type="text/plain")
    return _answer(request, lambda theme: speedup_bars(results.speedups(filters).rows, theme))


@gzip_page
@require_safe
def compare(request: HttpRequest) -> HttpResponseBase:
    """Default and best of several devices, by stage."""
    try:
        slugs = parse_devices(request.GET.getlist("devices"))
    except InvalidComparisonError as error:
        return HttpResponse(str(error), status=400, content_type="text/plain")
    columns = [compared(_found(results.device(slug))) for slug in slugs]
    return _answer(request, lambda theme: stage_bars(labelled(columns), theme))


@gzip_page
@require_safe
def session_frames(request: HttpRequest, uuid: UUID) -> HttpResponseBase:
    """Every run of a session, frame by frame."""
    session = _found(results.session(uuid))
    return _answer(
        request, lambda theme: frame_lines(session.runs, first_counted_frame(session.protocol), theme)
    )


@gzip_page
@require_safe
def session_stages(request: HttpRequest, uuid: UUID) -> HttpResponseBase:
    """Each configuration of a session, by stage."""
    session = _found(results.session(uuid))
    return _answer(
        request,
        lambda theme: stage_bars(stage_times(session.runs, first_counted_frame(session.protocol)), theme),
    )


@gzip_page
@require_safe
def run_stages(request: HttpRequest, uuid: UUID) -> HttpResponseBase:
    """One run, by stage and frame."""
    detail = _found(results.run(uuid))
    return _answer(
        request, lambda theme: stage_areas(detail.run, first_counted_frame(detail.protocol), theme)
    )


@gzip_page
@require_safe
def front(request: HttpRequest, slug: str) -> HttpResponseBase:
    """A front's points in the plane of error and runtime."""
    shown = _found(published.front(slug))
    return _answer(request, lambda theme: front_plane(shown.points, max_ate(shown.protocol), theme))


@gzip_page
@require_safe
def exploration(request: HttpRequest, key: int) -> HttpResponseBase:
    """Everything that an exploration measured, and its front."""
    seen = _found(watch(key))
    limit = ate_limit(seen.exploration)

    def draw(theme: Theme) -> go.Figure:
        have = found(seen)
        return exploration_plane(have.points, have.front, limit, theme)

    return _answer_of(request, seen, draw)


@gzip_page
@require_safe
def exploration_hypervolume(request: HttpRequest, key: int) -> HttpResponseBase:
    """How the hypervolume grew with each searched configuration."""
    seen = _found(watch(key))
    random = seen.phases["random"]
    return _answer_of(request, seen, lambda theme: hypervolume_line(growth_of(seen), random, theme))


@gzip_page
@require_safe
def exploration_importance(request: HttpRequest, key: int) -> HttpResponseBase:
    """Which parameters matter to which objective."""
    seen = _found(watch(key))

    def draw(theme: Theme) -> go.Figure:
        learnt = insight(seen)
        return importance_bars(learnt.shares if learnt else {}, theme)

    return _answer_of(request, seen, draw)


@gzip_page
@require_safe
def exploration_predictions(request: HttpRequest, key: int, objective: str) -> HttpResponseBase:
    """What a model foretold of one objective, against what was measured."""
    seen = _found(watch(key))
    if objective not in seen.exploration.objectives:
        raise Http404

    def draw(theme: Theme) -> go.Figure:
        learnt = insight(seen)
        return prediction_plane(objective, learnt.predictions[objective] if learnt else None, theme)

    return _answer_of(request, seen, draw)


def _found(row: Row | None) -> Row:
    if row is None:
        raise Http404
    return row


def _answer_of(request: HttpRequest, seen: Watch, draw: Callable[[Theme], go.Figure]) -> HttpResponseBase:
    """As `_answer`, without drawing where nothing was measured since: these figures are asked for often.

    To draw ten thousand marks takes half a second, so a figure is kept for whoever asks next.
    """
    facts = (request.path, _theme(request).name, seen.results, software.version())
    digest = hashlib.sha256(repr(facts).encode()).hexdigest()[:32]
    etag = quote_etag(digest)
    if (unchanged := get_conditional_response(request, etag=etag)) is not None:
        return unchanged
    body = cache.get(f"figure-{digest}")
    if body is None:
        body = _drawn(request, draw)
        cache.set(f"figure-{digest}", body, KEPT_SECONDS)
    return _response(request, body, etag)


def _answer(request: HttpRequest, draw: Callable[[Theme], go.Figure]) -> HttpResponseBase:
    """The figure in the theme that ?theme= names, or 304 where the caller holds the same one."""
    body = _drawn(request, draw)
    return _response(request, body, quote_etag(hashlib.sha256(body).hexdigest()[:32]))


def _theme(request: HttpRequest) -> Theme:
    return THEMES.get(request.GET.get("theme", ""), LIGHT)


def _drawn(request: HttpRequest, draw: Callable[[Theme], go.Figure]) -> bytes:
    return bytes(draw(_theme(request)).to_json(validate=False).encode())


def _response(request: HttpRequest, body: bytes, etag: str) -> HttpResponseBase:
    response = HttpResponse(body, content_type="application/json")
    response["ETag"] = etag
    # Kept by browsers, asked about each time: a new session shows at once.
    response["Cache-Control"] = "no-cache"
    return get_conditional_response(request, etag=etag, response=response) or response
