"""Around every request: an id that the client, the log and the tasks share; a line in the log; a count; no
NUL in an address.
"""

import logging
import re
import time
import uuid
from collections.abc import Callable

from django.http import HttpRequest, HttpResponse

from crowd import logs, metrics
from crowd.problems import Problem

HEADER = "X-Request-ID"
# What a proxy or a client may choose: nothing that could forge a line of the log.
CHOSEN = re.compile(r"[A-Za-z0-9._-]{8,64}")
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
# Asked every few seconds by those who watch: their lines would hide the others.
WATCHING = frozenset({"healthz", "readyz", "metrics"})

log = logging.getLogger("crowd.requests")


class RequestMiddleware:
    """The outermost one, so that whatever another answers is seen too.

    What is logged and counted is the pattern of the address, never the address itself, its query or whose it
    was: an address may hold the key of a submission.
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


class NoNullMiddleware:
    """Refuses an address that holds the character NUL with 400: PostgreSQL knows none in text."""

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
