"""The pages about data and method."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.content.exported import newest, tables_of
from crowd.dashboard.responses import page
from crowd.devices.models import DeviceModel
from crowd.fronts import selectors as published
from crowd.results.opendata.tables import LICENCE, TABLES
from crowd.results.validity.rules import RULES
from slam.definitions import SYSTEMS


@page
def data(request: HttpRequest) -> HttpResponse:
    """The page about open data and its fields."""
    export = newest()
    return render(
        request,
        "dashboard/data.html",
        {
            "export": export,
            "tables": tables_of(export) if export else (),
            "schema": TABLES,
            "systems": SYSTEMS,
            "simulations": DeviceModel.objects.filter(kind=DeviceModel.Kind.SIMULATED).exists(),
            "licence": LICENCE,
        },
    )


@page
def about(request: HttpRequest) -> HttpResponse:
    """The page about the method, the rules and privacy."""
    front = published.current(published.DEFAULT_APPLICATION)
    return render(
        request,
        "dashboard/about.html",
        {"front": front, "protocol": front.protocol if front else {}, "rules": RULES.values()},
    )
