"""The page that measures the device it is opened on, and the browser's client behind it."""

import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import render

from crowd.dashboard.answering import conditional, page
from frontrunner import __version__

TYPES = {
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "png": "image/png",
    "svg": "image/svg+xml",
    "webmanifest": "application/manifest+json",
}
# One dot: neither another folder, nor what only developers need.
NAME = re.compile(rf"[a-z0-9][a-z0-9-]*\.(?P<type>{'|'.join(TYPES)})")
# Together they give a page the precise clock. What it loads must allow it, so other pages do without.
ISOLATION = {
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Cross-Origin-Opener-Policy": "same-origin",
}

View = TypeVar("View", bound=Callable[..., HttpResponseBase])


def isolated(view: View) -> View:
    """A view whose answers make the page cross-origin isolated."""

    @wraps(view)
    def answered(*args: Any, **kwargs: Any) -> HttpResponseBase:
        response = view(*args, **kwargs)
        for name, value in ISOLATION.items():
            response[name] = value
        return response

    return answered  # type: ignore[return-value]


@page
@isolated
def measure(request: HttpRequest) -> HttpResponse:
    """Where a browser measures its device."""
    response = render(request, "dashboard/measure.html", {"version": __version__})
    response["Cache-Control"] = "no-cache"
    return response


@page
@isolated
def client_file(request: HttpRequest, name: str) -> HttpResponseBase:
    """The file NAME of the browser's client. Browsers ask each time whether theirs is the newest."""
    match = NAME.fullmatch(name)
    path = Path(settings.FRONTRUNNER_WEB_CLIENT) / name
    if match is None or not path.is_file():
        raise Http404(f"the browser's client has no file {name!r:.80}")
    return conditional(request, path.read_bytes(), TYPES[match["type"]])
