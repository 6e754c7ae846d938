"""A front's points."""

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.answering import found
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.figures.fronts import front_plane
from crowd.dashboard.figures.parameters import parameter_lines
from crowd.dashboard.points import parameters_of
from crowd.fronts import selectors as published
from crowd.fronts.content.protocol import max_ate
from crowd.fronts.selectors import Front


def read(request: HttpRequest, slug: str) -> Front:  # noqa: ARG001
    return found(published.front(slug))


def stamp(request: HttpRequest, slug: str) -> str:
    return read(request, slug).digest


def points_table(front: Front) -> Table:
    """A row for each point, with its parameters."""
    parameters = parameters_of(front)
    return Table(
        ("configuration", "runtime_s", "ate_max_m", "ate_mean_m", *parameters),
        [
            (
                point.name,
                point.runtime,
                point.ate_max,
                point.ate_mean,
                *(point.parameters.get(name) for name in parameters),
            )
            for point in front.points
        ],
    )


DRAWINGS = (
    Drawing(
        name="front",
        path="fronts/<str:slug>",
        definition="Largest distance between the estimated and the true trajectory, and mean computation "
        "time a frame, on the reference device alone.",
        read=read,
        draw=lambda front, theme: front_plane(front.points, max_ate(front.protocol), theme),
        table=points_table,
        title=lambda front: f"Front {front.slug}: error against runtime",
        n=lambda front: formats.plural(len(front.points), "configuration"),
        page=lambda slug: reverse("dashboard:front", args=[slug]),
        stamp=stamp,
    ),
    Drawing(
        name="front-parameters",
        path="fronts/<str:slug>/parameters",
        definition="Each configuration's value of each parameter; runtime is the mean computation time a "
        "frame on the reference device.",
        read=read,
        draw=lambda front, theme: parameter_lines(front.points, theme),
        table=points_table,
        title=lambda front: f"Front {front.slug}: its parameters",
        n=lambda front: formats.plural(len(front.points), "configuration"),
        page=lambda slug: reverse("dashboard:front", args=[slug]),
        stamp=stamp,
    ),
)
