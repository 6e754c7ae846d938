"""The page of response surfaces: time and error over two parameters."""

from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.content.surface import chosen, rows, shipped, summarise
from crowd.dashboard.figures.surfaces import surface_height
from crowd.dashboard.responses import page


@page
def surface(request: HttpRequest) -> HttpResponse:
    """Both quantities over the shipped grid, with statistics and provenance."""
    asked = request.GET.get("application", "")
    shown = chosen(asked)
    if asked and shown is None:
        raise Http404
    return render(
        request,
        "dashboard/surface.html",
        {
            "surface": shown,
            "choices": [(name, f"?application={name}") for name in shipped()],
            "query": f"application={shown.application}" if shown and len(shipped()) > 1 else "",
            "reading": summarise(shown) if shown else None,
            "rows": rows(shown) if shown else (),
            "height": surface_height(shown) if shown else 0,
        },
    )
