"""The pages about data and method."""

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.content.citation import version_of
from crowd.dashboard.content.exported import changes_by_day, other_files_of, tables_of
from crowd.dashboard.responses import page
from crowd.fronts import selectors as published
from crowd.http.problems import Problem
from crowd.results.opendata.releases import find_export, latest, listed_exports
from crowd.results.opendata.tables import LICENCE, TABLES
from crowd.results.validity.rules import RULES
from slam.definitions import SYSTEMS


@page
def data(request: HttpRequest) -> HttpResponse:
    """The page about open data and its fields."""
    export = latest()
    return render(
        request,
        "dashboard/data.html",
        {
            "export": export,
            "tables": tables_of(export) if export else (),
            "listed": listed_exports(),
            "schema": TABLES,
            "systems": SYSTEMS,
            "licence": LICENCE,
        },
    )


@page
def export(request: HttpRequest, name: str) -> HttpResponse:
    """The page of the export of a day, or of the latest one."""
    try:
        found = find_export(name)
    except Problem as problem:
        answer = render(request, "dashboard/no_export.html", {"problem": problem}, status=problem.status)
        if problem.retry_after is not None:
            answer["Retry-After"] = str(problem.retry_after)
        return answer
    context = {
        "export": found,
        "tables": tables_of(found),
        "others": other_files_of(found),
        "changes": changes_by_day(found),
        "version": version_of(found),
        "licence": LICENCE,
    }
    return render(request, "dashboard/export.html", context)


@page
def about(request: HttpRequest) -> HttpResponse:
    """The page about the method, the rules and privacy."""
    front = published.current(published.DEFAULT_APPLICATION)
    return render(
        request,
        "dashboard/about.html",
        {"front": front, "protocol": front.protocol if front else None, "rules": RULES.values()},
    )
