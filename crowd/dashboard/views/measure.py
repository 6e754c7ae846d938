"""The page on which a browser measures its device, and the files of that client.

A cross-origin isolated page has a clock that is twenty times finer. This page alone is isolated.
"""

from pathlib import Path
from typing import TypeVar

from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import render
from django.views.decorators.http import require_safe

from crowd.dashboard.answering import conditional, page

FOLDER = settings.BASE_DIR / "client_kit" / "web"
TYPES = {
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".webmanifest": "application/manifest+json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
}
Response = TypeVar("Response", bound=HttpResponseBase)
ISOLATION = {
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Embedder-Policy": "require-corp",
}


@page
def measure(request: HttpRequest) -> HttpResponse:
    """Measure this device in the browser."""
    return _isolated(render(request, "dashboard/measure.html"))


@require_safe
def client_file(request: HttpRequest, name: str) -> HttpResponseBase:
    """One file of the client, which asks again whether it changed."""
    path: Path = FOLDER / name
    kind = TYPES.get(path.suffix)
    if kind is None or not path.is_file():
        raise Http404(f"the browser's client has no file {name}")
    return _isolated(conditional(request, path.read_bytes(), kind))


def _isolated(response: Response) -> Response:
    for header, value in ISOLATION.items():
        response[header] = value
    return response
