"""The pages of a session and of a run."""

from typing import Any
from uuid import UUID

from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.comparing.application_choice import next_query
from crowd.dashboard.content.drift import readings, steps
from crowd.dashboard.content.race import race
from crowd.dashboard.content.stages import frames, spread, stage_table, times_of, tracking
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.devices import sensors_height
from crowd.dashboard.figures.frames import MOST_LINES, frames_height, stages_height
from crowd.dashboard.responses import or_404, page
from crowd.fronts import selectors as published
from crowd.results.reading import selectors as results
from crowd.results.reading.rows import SessionDetail
from wire.front import BEST


@page
def session(request: HttpRequest, uuid: UUID) -> HttpResponse:
    """A session: its speedups and its runs."""
    detail = or_404(results.session(uuid))
    best = detail.session.speedup(BEST)
    return render(
        request,
        "dashboard/session.html",
        {
            "detail": detail,
            "session": detail.session,
            "next_query": _next_query(detail.session.front),
            "protocol": detail.protocol,
            "lanes": race(best.speedup if best and not best.range else None),
            **of_session(detail),
        },
    )


@page
def run(request: HttpRequest, uuid: UUID) -> HttpResponse:
    """A run: its frames, its stages, and whether it counts."""
    detail = or_404(results.run(uuid))
    first_counted = detail.protocol.first_counted_frame
    stages = spread(detail.run, first_counted)
    return render(
        request,
        "dashboard/run.html",
        {
            "detail": detail,
            "run": detail.run.run,
            "next_query": _next_query(detail.session.front),
            "protocol": detail.protocol,
            "spread": stages,
            "finding": findings.run(stages),
            "tracking": tracking(detail.run),
            "frames": frames(detail.run, first_counted),
        },
    )


def _next_query(front: str) -> str:
    """The query that keeps the application of `front` in links to devices."""
    names = published.names()
    return next_query(dict(names)[front], names)


def of_session(detail: SessionDetail | None) -> dict[str, Any]:
    """The context of the charts of a session: stages, drift, sensors, heights."""
    stages = times_of(detail)
    sensors = readings(detail.samples) if detail else ()
    drifts = steps(detail) if detail else ()
    configurations = len({series.run.configuration for series in detail.runs}) if detail else 0
    return {
        "stages": stages,
        "stage_table": stage_table(stages),
        "stages_height": stages_height(len(stages), close=len(stages) > MOST_LINES),
        "frames_height": frames_height(configurations),
        "many": configurations > MOST_LINES,
        "leaves_out": any(not series.computed.all() for series in detail.runs) if detail else False,
        "findings": {
            "frames": findings.session(detail.session.speedups if detail else ()),
            "stages": findings.stages(stages),
            "drift": findings.drift(drifts),
            "sensors": findings.sensors(sensors),
        },
        "steps": drifts,
        "sensors": sensors,
        "sensors_height": sensors_height(len(sensors)),
    }
