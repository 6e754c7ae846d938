"""Around every request: an id that the client, the log and the tasks share; a line in the log; a count.

Refused before any view runs: a body that the server could not read, an address with the character NUL, too
many reads of pages.
"""

import logging
import math
import re
import time
import uuid
from collections.abc import Callable

from django.conf import settings
from django.http import HttpRequest, HttpResponse

from crowd.access import limits
from crowd.http.problems import Problem
from crowd.operations import logs, metrics

HEADER = "X-Request-ID"
# What a proxy or a client may choose: nothing that could forge a line of the log.
CHOSEN = re.compile(r"[A-Za-z0-9._-]{8,64}")
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
# Monitoring asks for these every few seconds: their lines would hide the others.
WATCHING = frozenset({"healthz", "readyz", "metrics"})
# Where the ASGI handler leaves the Problem of a body that it refused, in `request.META`.
BODY_REFUSAL = "frontrunner.body_refusal"
# Files that never change; monitoring; the API, whose endpoints have limits of their own.
NOT_PAGES = (
    "/sequences/",
    "/trajectories/",
    "/plans/",
    "/shaders/",
    "/healthz",
    "/readyz",
    "/metrics",
    "/api/",
    "/guide/_static/",
)
# A page; the files below it come with it, and are asked for each time.
MEASURE = "/measure/"
DOCUMENTATION = "/api/v1/docs"

log = logging.getLogger("crowd.requests")


class RequestMiddleware:
    """The outermost middleware: it also sees what the other ones answer.

    It logs and counts the pattern of the address, never the address itself, its query or the client: an
    address may hold the key of a submission.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        begun = time.perf_counter()
        chosen = request.headers.get(HEADER, "")
        name = chosen if CHOSEN.fullmatch(chosen) else uuid.uuid4().hex
        before = logs.request_id.set(name)
        try:
            response = self.get_response(request)
            response[HEADER] = name
            _note(request, response.status_code, time.perf_counter() - begun)
        finally:
            logs.request_id.reset(before)
        return response


class BodyRefusalMiddleware:
    """Answers for a body that the ASGI handler refused: too slow, too large, incomplete, too many at once.

    The answer is made here and not in the handler, so that it has a request id, is logged and is counted.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        refusal: Problem | None = request.META.get(BODY_REFUSAL)
        return self.get_response(request) if refusal is None else refusal.response()


class PageLimitMiddleware:
    """Limits how often one address reads pages, tables, cards and exports: 429 with Retry-After."""

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        if not _is_page(request.path):
            return self.get_response(request)
        limit = limits.Pages()
        allowed = limit.count(request)
        response = self.get_response(request) if allowed else _too_many(limit)
        for name, value in (limit.usage.headers if limit.usage else {}).items():
            response[name] = value
        return response


def _is_page(path: str) -> bool:
    if path in (DOCUMENTATION, MEASURE):
        return True
    return not path.startswith((settings.STATIC_URL, MEASURE, *NOT_PAGES))


def _too_many(limit: limits.Pages) -> HttpResponse:
    wait = math.ceil(limit.wait() or 1)
    text = f"too many requests: wait {wait} s\n"
    headers = {"Retry-After": str(wait)}
    return HttpResponse(text, status=429, content_type="text/plain; charset=utf-8", headers=headers)


class NoNullMiddleware:
    """Refuses an address that holds the character NUL with 400: text in PostgreSQL cannot hold it."""

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        if "\0" not in request.path and "%00" not in request.META.get("QUERY_STRING", ""):
            return self.get_response(request)
        refusal = "the address holds the character NUL (%00): leave it out"
        if request.path.startswith("/api/"):
            return Problem(400, "null_character", refusal).response()
        return HttpResponse(refusal, status=400, content_type="text/plain; charset=utf-8")


def _note(request: HttpRequest, status: int, seconds: float) -> None:
    method = request.method if request.method in METHODS else "OTHER"
    endpoint = logs.endpoint(request)
    metrics.requests.observe(method, endpoint, status, seconds)
    level = logging.DEBUG if endpoint in WATCHING and status < 500 else logging.INFO
    milliseconds = round(seconds * 1e3, 1)
    log.log(level, "%s /%s %d", method, endpoint, status, extra=logs.more(ms=milliseconds))
