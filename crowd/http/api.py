"""What every endpoint of the API shares: JSON in and out, bodies with a limit, lists by cursor."""

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
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from rest_framework.negotiation import BaseContentNegotiation
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from crowd.access import limits
from crowd.http.problems import Problem

T = TypeVar("T")
PAGE = 100
LONGEST_PAGE = 1000
WHOLE_NUMBER = re.compile(r"[0-9]{1,9}")
# A body may inflate to what it might have been without gzip, and beyond that to so many times its size.
INFLATION = 100


class AnyAccept(BaseContentNegotiation):
    """Answers are JSON whatever the client says it accepts: a refusal of the refusal would help nobody."""

    def select_parser(self, request: Request, parsers: Any) -> Any:  # noqa: ARG002
        return None

    def select_renderer(self, request: Request, renderers: Any, format_suffix: Any = None) -> Any:  # noqa: ARG002
        return renderers[0], renderers[0].media_type


class Endpoint(APIView):
    """A public address of the API: anybody may ask, so often."""

    content_negotiation_class = AnyAccept
    metadata_class = None  # OPTIONS would tell what is written for those who read the code
    throttle_classes: list[type[limits.Limit]] = [limits.Reads]
    usage: limits.Usage | None = None  # set by the limit, once it has counted

    def perform_authentication(self, request: Request) -> None:
        """Who asks. A token that is none counts as a request of its address: trying many is limited too."""
        try:
            super().perform_authentication(request)
        except Problem:
            limit = limits.Reads()
            if not limit.allow_request(request, self):
                self.throttled(request, limit.wait() or 1.0)
            raise

    def finalize_response(self, request: Request, response: Response, *args: Any, **kwargs: Any) -> Response:
        """Every answer, refusals too, tells what is left of the limit."""
        final = super().finalize_response(request, response, *args, **kwargs)
        for name, value in (self.usage.headers if self.usage else {}).items():
            final[name] = value
        return final


def answer(content: Any, status: int = 200, headers: dict[str, str] | None = None) -> HttpResponse:
    """CONTENT (structs, dicts, dates, UUIDs) as JSON."""
    return HttpResponse(
        msgspec.json.encode(content), status=status, content_type="application/json", headers=headers or {}
    )


def body(request: Request) -> bytes:
    """The request's JSON, inflated where it is gzipped.

    Raises Problem 415 for another type or encoding, 411 for an invalid or missing length, 413 for more bytes
    than the server takes, before or after inflating, 400 for damaged or incomplete content.
    """
    kind = request.headers.get("Content-Type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise Problem(415, "unsupported_media_type", f"send application/json, not {kind or 'nothing'}")
    encoding = request.headers.get("Content-Encoding", "identity").strip().lower()
    if encoding not in {"identity", "gzip"}:
        raise Problem(415, "unsupported_encoding", f"send gzip or no Content-Encoding, not {encoding}")
    http: HttpRequest = request._request
    if content_length(http) > settings.FRONTRUNNER_MAX_BODY_BYTES:
        raise _too_large()
    if "HTTP_TRANSFER_ENCODING" in http.META:
        # crowd.http.asgi_handler reads chunks. Under another server, reading on could wait for ever.
        raise Problem(411, "length_required", "send Content-Length: this server reads no body in chunks")
    try:
        content = http.body
    except OSError as error:
        raise Problem(400, "body_incomplete", "the connection ended before the body did") from error
    return _inflated(content) if encoding == "gzip" else content


def has_body(http: HttpRequest) -> bool:
    """Whether the request has a body. Raises Problem 411."""
    return content_length(http) > 0 or "HTTP_TRANSFER_ENCODING" in http.META


def content_length(http: HttpRequest) -> int:
    """The Content-Length of the request, 0 where it has none. Raises Problem 411 for an invalid one."""
    text = str(http.META.get("CONTENT_LENGTH") or "0")
    if not WHOLE_NUMBER.fullmatch(text):
        raise Problem(411, "length_required", f"Content-Length: {text:.20}: send a number of bytes")
    return int(text)


def _too_large() -> Problem:
    limit = settings.FRONTRUNNER_MAX_BODY_BYTES
    return Problem(413, "body_too_large", f"at most {limit} bytes a request: send fewer runs at once")


def _inflated(content: bytes) -> bytes:
    likely = max(settings.FRONTRUNNER_MAX_BODY_BYTES, INFLATION * len(content))
    limit = min(settings.FRONTRUNNER_MAX_INFLATED_BYTES, likely)
    inflater = zlib.decompressobj(wbits=16 + zlib.MAX_WBITS)
    try:
        inflated = inflater.decompress(content, limit + 1)
    except zlib.error as error:
        raise Problem(400, "damaged_gzip", f"Content-Encoding is gzip, the body is not: {error}") from error
    if len(inflated) > limit:
        raise Problem(
            413,
            "inflated_too_large",
            f"{len(content)} bytes inflate to more than {limit}: send fewer runs at once",
        )
    if not inflater.eof or inflater.unused_data:
        raise Problem(400, "damaged_gzip", "the gzip body is cut off, or goes on after its end")
    return inflated


def page(
    request: Request, rows: Sequence[T], key: Callable[[T], str], encode: Callable[[T], Any]
) -> dict[str, Any]:
    """One page of ROWS (in their order): `results`, and `next`, the address of the following page or null.

    The cursor names the last row's KEY and not its number, so that rows which come or go meanwhile are
    neither skipped nor repeated. Raises Problem 400 for an invalid limit or cursor.
    """

    def behind(limit: int, last: str | None) -> Sequence[T] | None:
        start = 0
        if last is not None:
            start = next((place + 1 for place, row in enumerate(rows) if key(row) == last), -1)
        return rows[start : start + limit] if start >= 0 else None

    return page_behind(request, behind, key, encode)


def page_behind(
    request: Request,
    read: Callable[[int, str | None], Sequence[T] | None],
    key: Callable[[T], str],
    encode: Callable[[T], Any],
) -> dict[str, Any]:
    """One page, as `page` makes it, of rows that are read a page at a time.

    READ gets a limit and the KEY of the last row of the page before, None for the first page. It returns None
    where that row does not exist.
    """
    text = request.query_params.get("limit", str(PAGE))
    if not WHOLE_NUMBER.fullmatch(text) or not 1 <= int(text) <= LONGEST_PAGE:
        raise Problem(400, "invalid_limit", f"limit={text:.50}: give 1 to {LONGEST_PAGE}", field="limit")
    limit, cursor = int(text), request.query_params.get("cursor")
    rows = read(limit + 1, None if cursor is None else _uncover(cursor))
    if rows is None:
        raise Problem(400, "invalid_cursor", "start again without a cursor", field="cursor")
    shown = rows[:limit]
    following = None
    if len(rows) > limit:
        query = request.query_params.dict() | {"cursor": _cover(key(shown[-1]))}
        following = f"{request.path}?{urlencode(query)}"
    return {"results": [encode(row) for row in shown], "next": following}


def refuse_unknown(request: Request, *known: str) -> None:
    """Raises Problem 400 for a query parameter of REQUEST that is not KNOWN and not empty: an ignored filter
    would seem to match everything.
    """
    for name, given in request.query_params.dict().items():
        if given.strip() and name not in known:
            right = f"this address takes {', '.join(known)}" if known else "this address takes no parameters"
            raise Problem(400, "invalid_filter", f"{name:.50}={given:.50}: {right}", field=f"{name:.50}")


def answer_or_unchanged(request: Request, content: Any) -> HttpResponseBase:
    """CONTENT as JSON with an ETag that is a digest of it; 304 without a body where the client has it."""
    full = answer(content, headers={"Cache-Control": "public, no-cache"})
    etag = quote_etag(hashlib.sha256(full.content).hexdigest()[:32])
    full["ETag"] = etag
    return get_conditional_response(request._request, etag=etag, response=full) or full


def _cover(key: str) -> str:
    return base64.urlsafe_b64encode(key.encode()).decode().rstrip("=")


def _uncover(cursor: str) -> str:
    try:
        return base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode()
    except ValueError:  # no ASCII, no base64, no UTF-8
        raise Problem(400, "invalid_cursor", "start again without a cursor", field="cursor") from None
