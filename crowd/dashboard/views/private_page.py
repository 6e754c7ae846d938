"""The private page of a participant."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from crowd.dashboard.languages import translated
from crowd.results.privacy.own_page import own_page


@require_safe
@never_cache
@translated
def mine(request: HttpRequest, signed: str) -> HttpResponse:
    """The results of one participant with the exact model name.

    Not cached, and not indexed by search engines.
    """
    page = own_page(signed)
    if page is None:
        return render(request, "404.html", status=404)
    answer = render(request, "dashboard/mine.html", {"page": page})
    answer["X-Robots-Tag"] = "noindex"
    # Other sites must not learn this address from links.
    answer["Referrer-Policy"] = "no-referrer"
    return answer
