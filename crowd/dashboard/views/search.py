"""Search for devices: the page, and suggestions while typing."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render
from django.utils.cache import patch_vary_headers

from crowd.dashboard.filtering import SCRIPT
from crowd.dashboard.responses import page
from crowd.results.reading import selectors as results

LONGEST = 100
LISTED = 40
SUGGESTED = 7


@page
def search(request: HttpRequest) -> HttpResponse:
    """Devices that match ?q=; only the first few for suggestions."""
    text = " ".join(request.GET.get("q", "").split())[:LONGEST]
    by_script = SCRIPT in request.headers
    most = SUGGESTED if by_script else LISTED
    answer = results.search(text)
    response = render(
        request,
        "dashboard/suggestions.html" if by_script else "dashboard/search.html",
        {
            "found": answer,
            "devices": answer.devices[:most],
            "unmeasured": answer.unmeasured[: max(most - len(answer.devices), 3 if not by_script else 0)],
        },
    )
    patch_vary_headers(response, [SCRIPT])
    return response
