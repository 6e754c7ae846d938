"""Devices side by side."""

from collections.abc import Sequence

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.comparison import Compared, compared, labelled, parse_devices
from crowd.dashboard.drawings.drawing import Drawing
from crowd.dashboard.drawings.sessions import stages_table
from crowd.dashboard.figures.frames import stage_bars
from crowd.dashboard.views.page import found
from crowd.results import selectors as results


def read(request: HttpRequest) -> list[Compared]:
    slugs = parse_devices(request.GET.getlist("devices"))
    return [compared(found(results.device(slug))) for slug in slugs]


def _n(columns: Sequence[Compared]) -> str:
    runs = sum(row.runs for row in labelled(columns))
    return f"{formats.plural(runs, 'run')} of {formats.plural(len(columns), 'session')}, the newest of each"


DRAWINGS = (
    Drawing(
        name="compare",
        path="compare",
        definition="Mean wall time a frame of each stage, default and best of each device, over the frames "
        "that count and over the runs of a configuration in the device's newest session.",
        read=read,
        draw=lambda columns, theme: stage_bars(labelled(columns), theme),
        table=lambda columns: stages_table(labelled(columns)),
        title=lambda columns: "Where the time goes: " + ", ".join(row.device.title for row in columns),
        n=_n,
        page=lambda: reverse("dashboard:compare"),
    ),
)
