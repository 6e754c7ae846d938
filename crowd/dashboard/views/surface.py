"""The response surface: what two parameters of KinectFusion do to its time and its error."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.answering import page
from crowd.dashboard.figures.surfaces import surface_height
from crowd.dashboard.surface import reading, rows, shipped


@page
def surface(request: HttpRequest) -> HttpResponse:
    """Both quantities over the grid that ships, with what it shows and where it was measured."""
    shown = shipped()
    return render(
        request,
        "dashboard/surface.html",
        {
            "surface": shown,
            "reading": reading(shown) if shown else None,
            "rows": rows(shown) if shown else (),
            "height": surface_height(shown) if shown else 0,
        },
    )
