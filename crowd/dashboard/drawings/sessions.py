"""Charts of sessions and runs by frame and stage."""

from collections.abc import Sequence
from uuid import UUID

from django.http import HttpRequest
from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.stages import StageTimes, frames, inside_computation, ordered, spread, times_of
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.frames import MOST_LINES, frame_lines, stage_areas, stage_bars
from crowd.dashboard.figures.palette import Theme
from crowd.dashboard.responses import or_404
from crowd.results.reading import selectors as results
from crowd.results.reading.rows import RunDetail, SessionDetail


def read_session(request: HttpRequest, uuid: UUID) -> SessionDetail:  # noqa: ARG001
    return or_404(results.session(uuid))


def read_run(request: HttpRequest, uuid: UUID) -> RunDetail:  # noqa: ARG001
    return or_404(results.run(uuid))


def frames_table(session: SessionDetail) -> Table:
    """A row per frame of each run."""
    first_counted = session.protocol.first_counted_frame
    return Table(
        ("run", "configuration", "repeat", "frame", "counted", "computation_s"),
        [
            (
                str(series.run.uuid),
                series.run.configuration,
                series.run.repeat,
                number,
                number >= first_counted,
                float(seconds),
            )
            for series in session.runs
            for number, seconds in enumerate(series.frame_seconds)
        ],
    )


def stages_table(rows: Sequence[StageTimes]) -> Table:
    """A row per configuration: seconds per frame of each stage, None if it lacks the stage."""
    stages = ordered({stage for row in rows for stage in row.seconds})
    return Table(
        ("configuration", "runs", "computation_s", *(f"{stage}_s" for stage in stages)),
        [
            (row.configuration, row.runs, row.computation, *(row.seconds.get(stage) for stage in stages))
            for row in rows
        ],
    )


def run_table(detail: RunDetail) -> Table:
    """A row per frame of the run, with its stages."""
    stages = tuple(f"{stage}_s" for stage in inside_computation(detail.run))
    return Table(
        ("frame", "counted", "tracked", "computation_s", *stages),
        [
            (frame.number, frame.counted, frame.tracked, frame.seconds, *frame.stages)
            for frame in frames(detail.run, detail.protocol.first_counted_frame)
        ],
    )


def _stages(rows: Sequence[StageTimes], theme: Theme) -> go.Figure:
    return stage_bars(rows, theme, close=len(rows) > MOST_LINES)


def _session_n(session: SessionDetail) -> str:
    return f"{formats.plural(len(session.runs), 'run')} of one session"


def _session_page(uuid: UUID) -> str:
    return reverse("dashboard:session", args=[uuid])


DRAWINGS = (
    Drawing(
        name="session-frames",
        path="sessions/<uuid:uuid>/frames",
        definition="Wall time of the computation of each frame. No statistic uses shaded frames.",
        read=read_session,
        draw=lambda session, theme: frame_lines(session.runs, session.protocol.first_counted_frame, theme),
        table=frames_table,
        title=lambda session: f"Frame by frame on {session.session.device.title}",
        finding=lambda session: findings.session(session.session.speedups),
        n=_session_n,
        page=_session_page,
    ),
    Drawing(
        name="session-stages",
        path="sessions/<uuid:uuid>/stages",
        definition="Mean wall time a frame of each stage, over the frames that count and over the runs of a "
        "configuration.",
        read=read_session,
        draw=lambda session, theme: _stages(times_of(session), theme),
        table=lambda session: stages_table(times_of(session)),
        title=lambda session: f"Where the time goes on {session.session.device.title}",
        finding=lambda session: findings.stages(times_of(session)),
        n=_session_n,
        page=_session_page,
    ),
    Drawing(
        name="run-stages",
        path="runs/<uuid:uuid>/stages",
        definition="Wall time of each stage in each frame, stacked. No statistic uses the shaded frames.",
        read=read_run,
        draw=lambda detail, theme: stage_areas(detail.run, detail.protocol.first_counted_frame, theme),
        table=run_table,
        title=lambda detail: f"One run of {detail.run.run.configuration} on {detail.session.device.title}",
        finding=lambda detail: findings.run(spread(detail.run, detail.protocol.first_counted_frame)),
        n=lambda detail: formats.plural(len(detail.run.frame_seconds), "frame") + " of one run",
        page=lambda uuid: reverse("dashboard:run", args=[uuid]),
    ),
)
