"""The page that measures a device in the browser, and the files of its client."""

import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from csp.constants import WASM_UNSAFE_EVAL
from csp.decorators import csp_update
from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import render
from django.utils.translation import gettext

from crowd.dashboard.languages import module_translations, translated
from crowd.dashboard.responses import conditional_response, page
from crowd.results.validity.rules import RULES
from groundwork import __version__

TYPES = {
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "png": "image/png",
    "svg": "image/svg+xml",
    "webmanifest": "application/manifest+json",
}
# One dot: no other folders, no files for developers.
NAME = re.compile(rf"[a-z0-9][a-z0-9-]*\.(?P<type>{'|'.join(TYPES)})")
# These headers give a page the precise clock. All that it loads must allow them, so other pages lack them.
ISOLATION = {
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Cross-Origin-Opener-Policy": "same-origin",
}
# Only this page compiles WebAssembly, and its workers, each of which has the policy of its own file.
WEBASSEMBLY = {"script-src": [WASM_UNSAFE_EVAL]}

View = TypeVar("View", bound=Callable[..., HttpResponseBase])


def isolated(view: View) -> View:
    """A view with headers for cross-origin isolation, which may compile WebAssembly."""

    @wraps(view)
    @csp_update(WEBASSEMBLY)
    def answered(*args: Any, **kwargs: Any) -> HttpResponseBase:
        response = view(*args, **kwargs)
        for name, value in ISOLATION.items():
            response[name] = value
        return response

    return answered  # type: ignore[return-value]


@page
@isolated
@translated
def measure(request: HttpRequest) -> HttpResponse:
    """The page that measures a device in the browser."""
    rules = {code: gettext(rule.words) for code, rule in RULES.items()}
    context = {"version": __version__, "rules": rules, "translations": module_translations()}
    response = render(request, "dashboard/measure.html", context)
    response["Cache-Control"] = "no-cache"
    return response


@page
@translated
def key(request: HttpRequest) -> HttpResponse:
    """The page that exports and erases with a token, which its address has after the #."""
    response = render(request, "dashboard/key.html", {"translations": module_translations()})
    response["X-Robots-Tag"] = "noindex"
    return response


@page
@isolated
def client_file(request: HttpRequest, name: str) -> HttpResponseBase:
    """The file `name` of the browser's client. Browsers revalidate it each time."""
    match = NAME.fullmatch(name)
    path = Path(settings.FRONTRUNNER_WEB_CLIENT) / name
    if match is None or not path.is_file():
        raise Http404(f"the browser's client has no file {name!r:.80}")
    return conditional_response(request, path.read_bytes(), TYPES[match["type"]])
