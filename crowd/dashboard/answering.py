"""How pages, figures and pictures answer: to reading alone, with nothing that the caller holds already."""

import hashlib
from collections.abc import Callable
from typing import TypeVar

from django.core.cache import cache
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.utils.cache import get_conditional_response
from django.utils.http import quote_etag
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

KEPT_SECONDS = 60

Row = TypeVar("Row")
View = TypeVar("View", bound=Callable[..., HttpResponseBase])


def page(view: View) -> View:
    """A view that only reads, compressed: these pages hold no secret that compression could give away."""
    return gzip_page(require_safe(view))


def found(row: Row | None) -> Row:
    """ROW, or the answer that there is nothing at this address."""
    if row is None:
        raise Http404
    return row


def tagged(request: HttpRequest, tag: str, make: Callable[[], HttpResponse]) -> HttpResponseBase:
    """What MAKE answers, under the entity tag TAG; 304 where the caller holds that, and nothing is made.

    Kept by browsers, asked about each time: a new session shows at once.
    """
    etag = quote_etag(tag)
    response = get_conditional_response(request, etag=etag) or make()
    response["ETag"] = etag
    response["Cache-Control"] = "no-cache"
    return response


def conditional(request: HttpRequest, body: bytes, kind: str) -> HttpResponseBase:
    """BODY, of the media type KIND; 304 where the caller holds the same."""
    return tagged(request, _digest(body), lambda: HttpResponse(body, content_type=kind))


def kept(facts: object, make: Callable[[], bytes]) -> bytes:
    """What MAKE draws, once a minute for all who ask while FACTS (by their repr) stay the same."""
    key = f"kept-{_digest(repr(facts).encode())}"
    body: bytes | None = cache.get(key)
    if body is None:
        body = make()
        cache.set(key, body, KEPT_SECONDS)
    return body


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
