"""What every page's view shares."""

from collections.abc import Callable
from typing import TypeVar

from django.http import Http404, HttpResponseBase
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_safe

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
