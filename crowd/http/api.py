"""What the endpoints of the API share: JSON in and out, limits of bodies, pagination by cursor."""

import base64
import hashlib
import re
import zlib
from collections.abc import Callable, Sequence
from typing import Any, TypeVar
from urllib.parse import urlencode

import msgspec
from django.conf import settings
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.middleware.gzip import GZipMiddleware
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from rest_framework.negotiation import BaseContentNegotiation
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from crowd.access import limits
from crowd.http.problems import Problem

T = TypeVar("T")
_gzip = GZipMiddleware(lambda _: HttpResponse())  # only its method for responses is used
DEFAULT_LIMIT = 100
MAX_LIMIT = 1000
WHOLE_NUMBER = re.compile(r"[0-9]{1,9}")
# A gzipped body may inflate to the limit of bodies without gzip, or to this multiple of its own size.
MAX_INFLATION_RATIO = 100


class IgnoreAccept(BaseContentNegotiation):
    """Responses are JSON whatever the client accepts: an error about an error would not help."""

    def select_parser(self, request: Request, parsers: Any) -> Any:  # noqa: ARG002
        return None

    def select_renderer(self, request: Request, renderers: Any, format_suffix: Any = None) -> Any:  # noqa: ARG002
        return renderers[0], renderers[0].media_type


class Endpoint(APIView):
    """A public endpoint of the API, with rate limits."""

    content_negotiation_class = IgnoreAccept
    metadata_class = None  # OPTIONS would show docstrings, which are for developers
    throttle_classes: list[type[limits.Limit]] = [limits.Reads]
    usage: limits.Usage | None = None  # set by the limit after it has counted

    def perform_authentication(self, request: Request) -> None:
        """Authenticate. An invalid token counts against its address's limit, so that guessing is limited."""
        try:
            super().perform_authentication(request)
        except Problem:
            limit = limits.Reads()
            if not limit.allow_request(request, self):
                self.throttled(request, limit.wait() or 1.0)
            raise

    def finalize_response(self, request: Request, response: Response, *args: Any, **kwargs: Any) -> Response:
        """Add what is left of the limit to every response, errors included. Compress public ones."""
        final = super().finalize_response(request, response, *args, **kwargs)
        for name, value in (self.usage.headers if self.usage else {}).items():
            final[name] = value
        if "Authorization" not in request.headers:
            _gzip.process_response(request._request, final)
        return final


def json_response(content: Any, status: int = 200, headers: dict[str, str] | None = None) -> HttpResponse:
    """`content` (structs, dicts, dates, UUIDs) as a JSON response."""
    return HttpResponse(
        msgspec.json.encode(content), status=status, content_type="application/json", headers=headers or {}
    )


def read_body(request: Request) -> bytes:
    """The JSON body of `request`, inflated if it is gzipped.

    Raises Problem 415 for another type or encoding, 411 for an invalid or missing length, 413 for too many
    bytes before or after inflating, 400 for damaged or incomplete content.
    """
    kind = request.headers.get("Content-Type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise Problem("unsupported_media_type", f"send application/json, not {kind or 'nothing'}")
    encoding = request.headers.get("Content-Encoding", "identity").strip().lower()
    if encoding not in {"identity", "gzip"}:
        raise Problem("unsupported_encoding", f"send gzip or no Content-Encoding, not {encoding}")
    http: HttpRequest = request._request
    if content_length(http) > settings.FRONTRUNNER_MAX_BODY_BYTES:
        raise _too_large()
    if "HTTP_TRANSFER_ENCODING" in http.META:
        # crowd.http.asgi_handler reads chunks. Under another server, reading could block forever.
        raise Problem("length_required", "send Content-Length: this server does not read chunked bodies")
    try:
        content = http.body
    except OSError as error:
        raise Problem("body_incomplete", "the connection ended before the body did") from error
    return _inflate(content) if encoding == "gzip" else content


def has_body(http: HttpRequest) -> bool:
    """Whether the request has a body. Raises Problem 411."""
    return content_length(http) > 0 or "HTTP_TRANSFER_ENCODING" in http.META


def content_length(http: HttpRequest) -> int:
    """The Content-Length of the request, 0 if it is absent. Raises Problem 411 for an invalid one."""
    text = str(http.META.get("CONTENT_LENGTH") or "0")
    if not WHOLE_NUMBER.fullmatch(text):
        raise Problem("length_required", f"Content-Length: {text:.20}: send a number of bytes")
    return int(text)


def _too_large() -> Problem:
    limit = settings.FRONTRUNNER_MAX_BODY_BYTES
    return Problem("body_too_large", f"at most {limit} bytes a request: send fewer runs at once")


def _inflate(content: bytes) -> bytes:
    likely = max(settings.FRONTRUNNER_MAX_BODY_BYTES, MAX_INFLATION_RATIO * len(content))
    limit = min(settings.FRONTRUNNER_MAX_INFLATED_BYTES, likely)
    inflater = zlib.decompressobj(wbits=16 + zlib.MAX_WBITS)
    try:
        inflated = inflater.decompress(content, limit + 1)
    except zlib.error as error:
        raise Problem("damaged_gzip", f"Content-Encoding is gzip, the body is not: {error}") from error
    if len(inflated) > limit:
        raise Problem(
            "inflated_too_large",
            f"{len(content)} bytes inflate to more than {limit}: send fewer runs at once",
        )
    if not inflater.eof or inflater.unused_data:
        raise Problem("damaged_gzip", "the gzip body is truncated, or continues after its end")
    return inflated


def paginate(
    request: Request, rows: Sequence[T], key: Callable[[T], str], encode: Callable[[T], Any]
) -> dict[str, Any]:
    """One page of `rows` (in their order): `results`, and `next`, the address of the following page or null.

    The cursor contains the `key` of the last row, not its position. Rows that are added or removed meanwhile
    do not shift the pages. Raises Problem 400 for an invalid limit or cursor.
    """

    def read(limit: int, last: str | None) -> Sequence[T] | None:
        start = 0
        if last is not None:
            start = next((index + 1 for index, row in enumerate(rows) if key(row) == last), -1)
        return rows[start : start + limit] if start >= 0 else None

    return paginate_query(request, read, key, encode)


def paginate_query(
    request: Request,
    read: Callable[[int, str | None], Sequence[T] | None],
    key: Callable[[T], str],
    encode: Callable[[T], Any],
) -> dict[str, Any]:
    """One page as in `paginate`, of rows that are read page by page.

    `read` gets a limit and the `key` of the last row of the page before, None for the first page. It returns
    None if that row does not exist.
    """
    text = request.query_params.get("limit", str(DEFAULT_LIMIT))
    if not WHOLE_NUMBER.fullmatch(text) or not 1 <= int(text) <= MAX_LIMIT:
        raise Problem("invalid_limit", f"limit={text:.50}: give 1 to {MAX_LIMIT}", field="limit")
    limit, cursor = int(text), request.query_params.get("cursor")
    rows = read(limit + 1, None if cursor is None else _decode_cursor(cursor))
    if rows is None:
        raise Problem("invalid_cursor", "start again without a cursor", field="cursor")
    shown = rows[:limit]
    following = None
    if len(rows) > limit:
        query = request.query_params.dict() | {"cursor": _encode_cursor(key(shown[-1]))}
        following = f"{request.path}?{urlencode(query)}"
    return {"results": [encode(row) for row in shown], "next": following}


def reject_unknown_parameters(request: Request, *known: str) -> None:
    """Raises Problem 400 if `request` has a query parameter, not empty, that is not `known`.

    If it were ignored, the results would look filtered and not be.
    """
    for name, given in request.query_params.dict().items():
        if given.strip() and name not in known:
            right = f"this address takes {', '.join(known)}" if known else "this address takes no parameters"
            raise Problem("invalid_filter", f"{name:.50}={given:.50}: {right}", field=f"{name:.50}")


def public_json(request: Request, content: Any, etag: str | None = None) -> HttpResponseBase:
    """`content` as JSON with an ETag; 304 without a body if the client has the same content.

    `etag` is a digest of the content unless given.
    """
    full = json_response(content, headers={"Cache-Control": "public, no-cache"})
    full["ETag"] = etag or quote_etag(hashlib.sha256(full.content).hexdigest()[:32])
    return get_conditional_response(request._request, etag=full["ETag"], response=full) or full


def _encode_cursor(key: str) -> str:
    return base64.urlsafe_b64encode(key.encode()).decode().rstrip("=")


def _decode_cursor(cursor: str) -> str:
    try:
        return base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode()
    except ValueError:  # not ASCII, base64 or UTF-8
        raise Problem("invalid_cursor", "start again without a cursor", field="cursor") from None
