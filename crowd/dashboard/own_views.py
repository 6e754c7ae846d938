"""The participant's own page."""

from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from crowd.results.privacy.own_page import own_page


@require_safe
@never_cache
def mine(request: HttpRequest, signed: str) -> HttpResponse:
    """What one participant measured, under the device's own name. Neither cached nor found by searching."""
    page = own_page(signed)
    if page is None:
        raise Http404
    answer = render(request, "dashboard/mine.html", {"page": page})
    answer["X-Robots-Tag"] = "noindex"
    # Links from here must not give this address to other sites.
    answer["Referrer-Policy"] = "no-referrer"
    return answer
