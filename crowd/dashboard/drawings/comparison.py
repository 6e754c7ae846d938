"""The chart of a comparison of devices, or of configurations on one device."""

from dataclasses import replace

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.comparing.application_choice import measured_device, measured_devices
from crowd.dashboard.comparing.comparison import (
    Comparison,
    compare_configurations,
    compare_devices,
    parse_names,
)
from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.drawings.drawing import Drawing
from crowd.dashboard.drawings.sessions import stages_table
from crowd.dashboard.figures.frames import stage_bars
from crowd.dashboard.responses import or_404
from crowd.fronts import selectors as published


def read(request: HttpRequest) -> Comparison:
    """The comparison for ?devices=a,b or ?configurations=x,y&device=a.

    The application is the requested one, otherwise one that all devices have. Raises InvalidComparisonError,
    Http404.
    """
    slug, named = (request.GET.get(name, "") for name in ("device", "application"))
    if slug:
        names = parse_names(request.GET.getlist("configurations"), "configurations")
        first = measured_device(slug, named)
        figure = newest_figure(first.detail)
        front = figure.front if figure else or_404(first.detail.latest).session.front
        shown = compare_configurations(first.detail, or_404(published.front(front)), names)
    else:
        first, *others = measured_devices(parse_names(request.GET.getlist("devices"), "devices"), named)
        shown = compare_devices([first.detail, *(one.detail for one in others)])
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
    ),
)
