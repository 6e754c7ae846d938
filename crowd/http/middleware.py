"""Middleware of every request: an id that client, log and tasks share, a line in the log, a metric.

It refuses, before any view runs, a body that the server could not read, an address with the character NUL,
and too many reads of pages.
"""

import logging
import math
import re
import time
import uuid
from collections.abc import Callable

from django.conf import settings
from django.core.exceptions import DisallowedHost
from django.http import HttpRequest, HttpResponse
from django.http.request import split_domain_port

from crowd.access import limits
from crowd.access.addresses import is_this_machine
from crowd.http.problems import Problem
from crowd.observability import logs, metrics

REQUEST_ID_HEADER = "X-Request-ID"
# An id that a proxy or a client may choose: it must not be able to forge a line of the log.
VALID_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{8,64}")
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
# Monitoring requests these every few seconds: their lines would hide the others.
MONITORING_ENDPOINTS = frozenset({"healthz", "readyz", "metrics"})
# Where the ASGI handler leaves the Problem of a body that it refused, in `request.META`.
BODY_REFUSAL = "frontrunner.body_refusal"
LOCAL_HOSTS = frozenset({"localhost", "127.0.0.1", "[::1]"})
# Immutable files, monitoring, and the API, whose endpoints have their own limits.
NOT_PAGES = (
    "/sequences/",
    "/trajectories/",
    "/plans/",
    "/shaders/",
    "/modules/",
    "/healthz",
    "/readyz",
    "/metrics",
    "/api/",
    "/guide/_static/",
)
# A page. The files below it are requested each time with the page.
MEASURE = "/measure/"
DOCUMENTATION = "/api/v1/docs"
OPEN_DATA = "/data/"

log = logging.getLogger("crowd.requests")


class RequestMiddleware:
    """The outermost middleware: it also sees the responses of the others.

    It logs and counts the pattern of the address, never the address, its query or the client: an address may
    contain the key of a submission.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        begun = time.perf_counter()
        chosen = request.headers.get(REQUEST_ID_HEADER, "")
        name = chosen if VALID_REQUEST_ID.fullmatch(chosen) else uuid.uuid4().hex
        before = logs.request_id.set(name)
        try:
            response = self.get_response(request)
            response[REQUEST_ID_HEADER] = name
            _log_request(request, response, time.perf_counter() - begun)
        finally:
            logs.request_id.reset(before)
        return response


class BodyRefusalMiddleware:
    """Responds to a body that the ASGI handler refused: too slow, too large, incomplete, too many at once.

    The handler does not respond itself, so that the response has a request id, is logged and is counted.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        refusal: Problem | None = request.META.get(BODY_REFUSAL)
        return self.get_response(request) if refusal is None else refusal.response()


class LocalHostMiddleware:
    """Refuses requests from elsewhere for this machine's own names on a server with a public name (400).

    Links of answers have the host of their request, and caches of proxies may keep them for others.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        host = split_domain_port(request.get_host())[0]
        if settings.PUBLIC_HOSTS and host in LOCAL_HOSTS and not is_this_machine(request):
            raise DisallowedHost(f"Host: {host} is for requests from this machine itself: use a public name")
        return self.get_response(request)


class PageLimitMiddleware:
    """Limits how often one address reads pages, tables, cards and exports: 429 with Retry-After.

    Ranges of exports have a limit of their own.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        if not _is_page(request.path):
            return self.get_response(request)
        ranged = request.path.startswith(OPEN_DATA) and "Range" in request.headers
        limit = limits.Ranges() if ranged else limits.Pages()
        allowed = limit.count(request)
        response = self.get_response(request) if allowed else _too_many_requests(limit)
        for name, value in (limit.usage.headers if limit.usage else {}).items():
            response[name] = value
        return response


def _is_page(path: str) -> bool:
    if path in (DOCUMENTATION, MEASURE):
        return True
    return not path.startswith((settings.STATIC_URL, MEASURE, *NOT_PAGES))


def _too_many_requests(limit: limits.Limit) -> HttpResponse:
    wait = math.ceil(limit.wait() or 1)
    text = f"too many requests: wait {wait} s\n"
    headers = {"Retry-After": str(wait)}
    return HttpResponse(text, status=429, content_type="text/plain; charset=utf-8", headers=headers)


class NoNullMiddleware:
    """Refuses an address with the character NUL (400): PostgreSQL cannot store it in text."""

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponse]) -> None:
        self.get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponse:
        if "\0" not in request.path and "%00" not in request.META.get("QUERY_STRING", ""):
            return self.get_response(request)
        refusal = "the address contains the character NUL (%00): leave it out"
        if request.path.startswith("/api/"):
            return Problem("null_character", refusal).response()
        return HttpResponse(refusal, status=400, content_type="text/plain; charset=utf-8")


def method_label(method: str | None) -> str:
    """`method` as metrics count it: whatever a client makes up is one."""
    return method if method in METHODS else "OTHER"


def _log_request(request: HttpRequest, response: HttpResponse, seconds: float) -> None:
    method, endpoint, status = method_label(request.method), logs.endpoint(request), response.status_code
    metrics.registry.observe("request_seconds", seconds, method, endpoint, str(status))
    if code := getattr(response, "problem_code", ""):
        metrics.registry.count("problems_total", endpoint, code)
    level = logging.DEBUG if endpoint in MONITORING_ENDPOINTS and status < 500 else logging.INFO
    milliseconds = round(seconds * 1e3, 1)
    log.log(level, "%s /%s %d", method, endpoint, status, extra=logs.fields(ms=milliseconds))
