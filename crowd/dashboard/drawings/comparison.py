"""Devices, or configurations on one device, side by side."""

from dataclasses import replace

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.answering import found
from crowd.dashboard.comparing.application_choice import measured, together
from crowd.dashboard.comparing.comparison import Comparison, of_configurations, of_devices, parse_names
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.drawings.drawing import Drawing
from crowd.dashboard.drawings.sessions import stages_table
from crowd.dashboard.figures.frames import stage_bars
from crowd.fronts import selectors as published


def read(request: HttpRequest) -> Comparison:
    """What ?devices=a,b or ?configurations=x,y&device=a asks for, of the application that is named, else of
    one that all of them have. Raises InvalidComparisonError, Http404.
    """
    slug, named = (request.GET.get(name, "") for name in ("device", "application"))
    if slug:
        names = parse_names(request.GET.getlist("configurations"), "configurations")
        first = measured(slug, named)
        figure = newest_figure(first.detail)
        front = figure.front if figure else found(first.detail.latest).session.front
        shown = of_configurations(first.detail, found(published.front(front)), names)
    else:
        first, *others = together(parse_names(request.GET.getlist("devices"), "devices"), named)
        shown = of_devices([first.detail, *(one.detail for one in others)])
    return replace(shown, application=first.application, applications=first.applications)


def _n(shown: Comparison) -> str:
    runs = formats.plural(sum(row.runs for row in shown.bars), "run")
    sessions = formats.plural(len(shown.devices) or 1, "session")
    return f"{runs} of {sessions}, the newest of each device"


def _title(shown: Comparison) -> str:
    if shown.device:
        return f"Where the time goes on {shown.device.title}"
    return "Where the time goes: " + ", ".join(column.device.title for column in shown.devices)


DRAWINGS = (
    Drawing(
        name="compare",
        path="compare",
        definition="Mean wall time a frame of each stage, over the frames that count and over the runs of a "
        "configuration in the device's newest session.",
        read=read,
        draw=lambda shown, theme: stage_bars(shown.bars, theme),
        table=lambda shown: stages_table(shown.bars),
        title=_title,
        n=_n,
        page=lambda: reverse("dashboard:compare"),
        simulated=lambda shown: shown.simulated,
    ),
)
