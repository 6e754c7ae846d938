"""Pages to read: where the data are, and how it is measured."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.answering import page
from crowd.dashboard.content.exported import newest, tables_of
from crowd.dashboard.content.parameter_meanings import MEANINGS
from crowd.devices.models import DeviceModel
from crowd.fronts import selectors as published
from crowd.results.opendata.tables import LICENCE, TABLES
from crowd.results.validity.rules import RULES


@page
def data(request: HttpRequest) -> HttpResponse:
    """Where the raw numbers are, and what each field means."""
    export = newest()
    return render(
        request,
        "dashboard/data.html",
        {
            "export": export,
            "tables": tables_of(export) if export else (),
            "schema": TABLES,
            "parameters": MEANINGS,
            "simulations": DeviceModel.objects.filter(kind=DeviceModel.Kind.SIMULATED).exists(),
            "licence": LICENCE,
        },
    )


@page
def about(request: HttpRequest) -> HttpResponse:
    """What is measured, how a figure comes about, and what is known of the people behind it."""
    front = published.current(published.DEFAULT_APPLICATION)
    return render(
        request,
        "dashboard/about.html",
        {"front": front, "protocol": front.protocol if front else {}, "rules": RULES.values()},
    )
