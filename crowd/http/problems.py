"""Errors of the API as application/problem+json (RFC 9457)."""

import logging
import math
import sys
from http import HTTPStatus
from typing import Any

import msgspec
from django.core.exceptions import PermissionDenied
from django.db import Error, InterfaceError, OperationalError, ProgrammingError
from django.http import Http404, HttpRequest, HttpResponse
from django.views.decorators.csrf import csrf_exempt
from django.views.defaults import bad_request, server_error
from rest_framework import exceptions

from crowd.files import UnavailableError
from crowd.http import codes
from crowd.http.preparation import find_unprepared
from crowd.observability import logs

CONTENT_TYPE = "application/problem+json"
RETRY_SECONDS = 5
PREPARATION_SECONDS = 60

log = logging.getLogger(__name__)


class Problem(Exception):  # noqa: N818 - the name of the thing in RFC 9457
    """A refusal with a stable `code` for programs, a `detail` for people and the `field` that is wrong.

    The code determines the status, unless `status` is given. Raises KeyError for a code that is not
    documented.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        status: int | None = None,
        field: str | None = None,
        retry_after: int | None = None,
        **members: Any,
    ) -> None:
        super().__init__(detail)
        self.type = codes.type_uri(code)
        self.status = codes.CODES[code].status if status is None else status
        self.code = code
        self.detail = detail
        self.field = field
        self.retry_after = retry_after
        self.members = members

    def response(self) -> HttpResponse:
        """The problem as an HTTP response."""
        document = {
            "type": self.type,
            "title": HTTPStatus(self.status).phrase,
            "status": self.status,
            "code": self.code,
            "detail": self.detail,
        }
        if self.field is not None:
            document["field"] = self.field
        if logs.request_id.get():
            document["request_id"] = logs.request_id.get()
        response = HttpResponse(
            msgspec.json.encode(document | self.members), status=self.status, content_type=CONTENT_TYPE
        )
        response.problem_code = self.code  # type: ignore[attr-defined]  # which metrics count
        if self.retry_after is not None:
            response["Retry-After"] = str(self.retry_after)
        if self.status == HTTPStatus.UNAUTHORIZED:
            response["WWW-Authenticate"] = "Bearer"
        return response


def not_found(what: str) -> Problem:
    """404, with `what` does not exist."""
    return Problem("not_found", what)


def exception_handler(error: Exception, context: dict[str, Any]) -> HttpResponse | None:  # noqa: ARG001 - DRF's signature
    """Django REST framework's exception handler: turns what a view raises into a problem."""
    match error:
        case Problem():
            return error.response()
        case exceptions.MethodNotAllowed():
            return Problem("method_not_allowed", str(error.detail)).response()
        case exceptions.Throttled():
            wait = math.ceil(getattr(error, "wait", None) or 1)
            detail = f"too many requests: wait {wait} s"
            return Problem("too_many_requests", detail, retry_after=wait).response()
        case exceptions.APIException():
            return Problem("bad_request", str(error.detail), status=error.status_code).response()
        case Http404():
            return not_found(str(error) or "there is nothing here").response()
        case PermissionDenied():
            return Problem("forbidden", str(error) or "not allowed").response()
        case OperationalError() | InterfaceError():
            return unprepared(error) or database_unavailable()
    return None


def database_unavailable() -> HttpResponse:
    """503 for a locked, full or unreachable database. The client keeps its data and tries again."""
    log.exception("the database does not answer")
    return Problem(
        "database_unavailable", "the database does not answer now", retry_after=RETRY_SECONDS
    ).response()


def unprepared(error: BaseException | None) -> HttpResponse | None:
    """503 where `error` is due to a server that was never prepared, otherwise None.

    A database that does not answer is not asked once more. A table that is missing is a ProgrammingError on
    PostgreSQL and "no such table" on SQLite, a static file a ValueError.
    """
    missing_in_sqlite = isinstance(error, OperationalError) and "no such" in str(error)
    if not (missing_in_sqlite or isinstance(error, ProgrammingError | ValueError)):
        return None
    try:
        missing = find_unprepared()
    except Error:
        return None
    if not missing:
        return None
    log.error(missing)
    return Problem("server_not_prepared", missing, retry_after=PREPARATION_SECONDS).response()


def bad_request_view(request: HttpRequest, exception: Exception) -> HttpResponse:
    """Django's handler400, for example for a host that FRONTRUNNER_HOSTS does not name."""
    if not request.path.startswith("/api/"):
        return bad_request(request, exception)
    return Problem("bad_request", str(exception) or "this request cannot be served").response()


def server_error_view(request: HttpRequest) -> HttpResponse:
    """Django's handler500: a problem under /api/, Django's page elsewhere.

    A database or a bucket that does not answer, and a server that is not prepared, give 503 everywhere.
    """
    error = sys.exception()
    if (answer := unprepared(error)) is not None:
        return answer
    if isinstance(error, OperationalError | InterfaceError):
        return database_unavailable()
    if isinstance(error, UnavailableError):
        log.error(error)
        return Problem(
            "files_unavailable", "the bucket does not answer", retry_after=RETRY_SECONDS
        ).response()
    if not request.path.startswith("/api/"):
        return server_error(request)
    detail = "the server failed; nothing was stored. Its log has the reason"
    return Problem("internal_error", detail).response()


# Without the exemption, a POST would get an error about CSRF cookies, which no API client has.
@csrf_exempt
def not_found_view(request: HttpRequest) -> HttpResponse:
    """404 for any path under /api/ without a view."""
    return not_found(f"{request.path} is not an address of this API: see /api/v1/docs").response()
