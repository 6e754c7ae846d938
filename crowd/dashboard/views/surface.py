"""The response surface: what two parameters of an application do to its time and its error."""

from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.answering import page
from crowd.dashboard.content.surface import chosen, reading, rows, shipped
from crowd.dashboard.figures.surfaces import surface_height


@page
def surface(request: HttpRequest) -> HttpResponse:
    """Both quantities over the grid that ships, with what it shows and where it was measured."""
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
            "reading": reading(shown) if shown else None,
            "rows": rows(shown) if shown else (),
            "height": surface_height(shown) if shown else 0,
        },
    )
