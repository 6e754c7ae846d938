"""The chart of a front."""

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.content.points import MeasuredFront, measured_front, parameters_of
from crowd.dashboard.drawings.drawing import Drawing, Table, titled
from crowd.dashboard.figures.fronts import front_plane
from crowd.dashboard.responses import or_404
from crowd.devices import revision
from crowd.fronts import selectors as published
from crowd.results.reading.queries.filters import SpeedupFilters


def read(request: HttpRequest, slug: str) -> MeasuredFront:
    front = or_404(published.front(slug))
    return measured_front(front, SpeedupFilters.parse(request.GET))


def stamp(request: HttpRequest, slug: str) -> tuple[str, str, str]:
    front = or_404(published.front(slug))
    return front.digest, SpeedupFilters.parse(request.GET).query(), revision.current()


def points_table(shown: MeasuredFront) -> Table:
    """A row per point, fastest first: predicted values, figures of the crowd, parameters."""
    parameters = parameters_of(shown.front)
    return Table(
        (
            "configuration", "runtime_s", "ate_max_m", "ate_mean_m", "crowd_speedup", "crowd_low",
            "crowd_high", "crowd_devices", *parameters,
        ),
        [
            (
                row.point.name, row.point.runtime, row.point.ate_max, row.point.predicted.ate_mean,
                row.crowd.mean if row.crowd else None,
                row.crowd.low if row.crowd else None,
                row.crowd.high if row.crowd else None,
                row.crowd.devices if row.crowd else None,
                *(row.point.parameters.get(name) for name in parameters),
            )
            for row in shown.points
        ],
    )  # fmt: skip


def _n(shown: MeasuredFront) -> str:
    count = formats.plural(len(shown.points), "configuration")
    return f"{count}, the crowd: up to {formats.plural(shown.most, 'device')}" if shown.most else count


DRAWINGS = (
    Drawing(
        name="front",
        path="fronts/<str:slug>",
        definition="Largest distance between the estimated and the true trajectory, and mean computation "
        "time a frame, on the reference device. The staircase joins the points of the front. Diamonds: the "
        "default's time over the crowd's mean speedup, narrow where fewer devices stand behind it.",
        read=read,
        draw=front_plane,
        table=points_table,
        title=lambda shown: titled("Error against time", shown.front.slug, shown.filters),
        n=_n,
        page=lambda slug: reverse("dashboard:front", args=[slug]),
        stamp=stamp,
    ),
)
