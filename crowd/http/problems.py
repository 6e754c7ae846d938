"""Errors of the API as application/problem+json (RFC 9457): a stable code, what was wrong and where."""

import logging
import math
import sys
from http import HTTPStatus
from typing import Any

import msgspec
from django.core.exceptions import PermissionDenied
from django.db import InterfaceError, OperationalError
from django.http import Http404, HttpRequest, HttpResponse
from django.views.decorators.csrf import csrf_exempt
from django.views.defaults import bad_request, server_error
from rest_framework import exceptions

from crowd.http import codes
from crowd.operations import logs

CONTENT_TYPE = "application/problem+json"
RETRY_SECONDS = 5

log = logging.getLogger(__name__)


class Problem(Exception):  # noqa: N818 - the name of the thing in RFC 9457
    """A refusal that the client is told in full: a stable `code`, `detail` for people, `field` says where.

    Raises KeyError for a code that is not documented.
    """

    def __init__(
        self,
        status: int,
        code: str,
        detail: str,
        *,
        field: str | None = None,
        retry_after: int | None = None,
        **members: Any,
    ) -> None:
        super().__init__(detail)
        self.type = codes.address(code)
        self.status = status
        self.code = code
        self.detail = detail
        self.field = field
        self.retry_after = retry_after
        self.members = members

    def response(self) -> HttpResponse:
        """The refusal as an HTTP answer."""
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
        if self.retry_after is not None:
            response["Retry-After"] = str(self.retry_after)
        if self.status == HTTPStatus.UNAUTHORIZED:
            response["WWW-Authenticate"] = "Bearer"
        return response


def not_found(what: str) -> Problem:
    """404 for something that does not exist, or never did."""
    return Problem(404, "not_found", what)


def handler(error: Exception, context: dict[str, Any]) -> HttpResponse | None:  # noqa: ARG001 - DRF's signature
    """Django REST framework's exception handler: what a view raises becomes a problem."""
    match error:
        case Problem():
            return error.response()
        case exceptions.MethodNotAllowed():
            return Problem(405, "method_not_allowed", str(error.detail)).response()
        case exceptions.Throttled():
            wait = math.ceil(getattr(error, "wait", None) or 1)
            detail = f"too many requests: wait {wait} s"
            return Problem(429, "too_many_requests", detail, retry_after=wait).response()
        case exceptions.APIException():
            return Problem(error.status_code, "bad_request", str(error.detail)).response()
        case Http404():
            return not_found(str(error) or "there is nothing here").response()
        case PermissionDenied():
            return Problem(403, "forbidden", str(error) or "not allowed").response()
        case OperationalError() | InterfaceError():
            return unavailable()
    return None


def unavailable() -> HttpResponse:
    """A locked, full or absent database: the client keeps what it has and comes again."""
    log.exception("the database does not answer")
    return Problem(
        503, "database_unavailable", "the database does not answer now", retry_after=RETRY_SECONDS
    ).response()


def refused(request: HttpRequest, exception: Exception) -> HttpResponse:
    """Django's handler400, such as for a host that FRONTRUNNER_HOSTS does not name."""
    if not request.path.startswith("/api/"):
        return bad_request(request, exception)
    return Problem(400, "bad_request", str(exception) or "this request cannot be served").response()


def unforeseen(request: HttpRequest) -> HttpResponse:
    """Django's handler500: a problem under the API, the plain page elsewhere.

    A database that does not answer is no failure of the server: 503, whatever asked for it.
    """
    if isinstance(sys.exception(), OperationalError | InterfaceError):
        return unavailable()
    if not request.path.startswith("/api/"):
        return server_error(request)
    detail = "the server failed; nothing was stored. Its log has the reason"
    return Problem(500, "internal_error", detail).response()


# Without the exemption a POST would be told of cookies that no client has.
@csrf_exempt
def unknown_address(request: HttpRequest) -> HttpResponse:
    """Any address under the API that no view answers."""
    return not_found(f"{request.path} is not an address of this API: see /api/v1/docs").response()
