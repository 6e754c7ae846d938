"""Responses of pages, figures and pictures: read-only, compressed, with ETags."""

import hashlib
from collections.abc import Callable
from typing import TypeVar

from django.core.cache import cache
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

CACHE_SECONDS = 60

Row = TypeVar("Row")
View = TypeVar("View", bound=Callable[..., HttpResponseBase])


def page(view: View) -> View:
    """A read-only view with compression. The pages hold no secrets that compression could leak."""
    return gzip_page(require_safe(view))


def or_404(row: Row | None) -> Row:
    """`row`. Raises Http404 if it is None."""
    if row is None:
        raise Http404
    return row


def respond_with_etag(request: HttpRequest, tag: str, make: Callable[[], HttpResponse]) -> HttpResponseBase:
    """The response of `make` with the entity tag `tag`, or 304 if the caller has it.

    Browsers revalidate each time, so that a new session shows at once.
    """
    etag = quote_etag(tag)
    response = get_conditional_response(request, etag=etag) or make()
    response["ETag"] = etag
    response["Cache-Control"] = "no-cache"
    return response


def conditional_response(request: HttpRequest, body: bytes, kind: str) -> HttpResponseBase:
    """`body` with the media type `kind`, or 304 if the caller has it."""
    return respond_with_etag(request, _digest(body), lambda: HttpResponse(body, content_type=kind))


def cached(facts: object, make: Callable[[], bytes]) -> bytes:
    """The result of `make`, cached for a minute under the repr of `facts`."""
    key = f"cached-{_digest(repr(facts).encode())}"
    body: bytes | None = cache.get(key)
    if body is None:
        body = make()
        cache.set(key, body, CACHE_SECONDS)
    return body


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
