"""Charts of an exploration: measurements, growth of the front, and a model of them.

Pages request these figures repeatedly while an exploration runs, and drawing ten thousand marks takes half a
second. So they are cached under a stamp that changes with new measurements.
"""

from collections.abc import Sequence
from typing import Any

from django.http import Http404, HttpRequest
from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.citation import UNRELEASED
from crowd.dashboard.content.searches import ate_limit, growth_of, yield_of
from crowd.dashboard.drawings.drawing import Drawing, Table
from crowd.dashboard.figures.explorations import (
    exploration_plane,
    growth_line,
    importance_bars,
    prediction_plane,
)
from crowd.dashboard.figures.palette import Theme
from crowd.dashboard.responses import or_404
from crowd.explorations.models import Evaluation
from crowd.explorations.outcomes import watching
from crowd.explorations.outcomes.insights import insight
from crowd.explorations.outcomes.watching import ExplorationStatus, watch
from crowd.explorations.searching.points import Point
from pareto.surrogates.prediction import Prediction


def read(request: HttpRequest, key: int) -> ExplorationStatus:  # noqa: ARG001
    return or_404(watch(key))


def read_objective(request: HttpRequest, key: int, objective: str) -> tuple[ExplorationStatus, str]:
    seen = read(request, key)
    if objective not in seen.exploration.objectives:
        raise Http404
    return seen, objective


def stamp(request: HttpRequest, key: int, **_: Any) -> str:
    return read(request, key).results


def plane(seen: ExplorationStatus, theme: Theme) -> go.Figure:
    have = watching.results_of(seen)
    random = yield_of(seen.exploration, have, Evaluation.Phase.RANDOM)
    learned = Evaluation.Phase.ACTIVE in have.phases
    front = random.front if learned else ()
    return exploration_plane(have.points, have.front, ate_limit(seen.exploration), theme, front)


def points_table(seen: ExplorationStatus) -> Table:
    """A row per measured configuration, with its objectives and parameters.

    `censored` names the objectives that are lower bounds.
    """
    have = watching.results_of(seen)
    objectives = [name for name in formats.OBJECTIVES if any(name in point.values for point in have.points)]
    parameters = list(dict.fromkeys(name for point in have.points for name in point.configuration))
    front = {id(point) for point in have.front}
    return Table(
        (
            "phase",
            "label",
            "on_front",
            "censored",
            *(formats.unit_column(name) for name in objectives),
            *parameters,
        ),
        [_cells(point, id(point) in front, objectives, parameters) for point in have.points],
    )


def _cells(
    point: Point, on_front: bool, objectives: Sequence[str], parameters: Sequence[str]
) -> tuple[Any, ...]:
    return (
        point.phase,
        point.label,
        on_front,
        ",".join(point.censored),
        *(point.values.get(name) for name in objectives),
        *(point.configuration.get(name) for name in parameters),
    )


def growth_table(seen: ExplorationStatus) -> Table:
    """The covered share after each searched configuration."""
    return Table(("configurations", "covered_share"), list(enumerate(growth_of(seen), 1)))


def shares(seen: ExplorationStatus) -> dict[str, Any]:
    learnt = insight(seen)
    return dict(learnt.shares) if learnt else {}


def shares_table(seen: ExplorationStatus) -> Table:
    """Each parameter's share of the variance of each objective."""
    return Table(
        ("objective", "parameter", "share"),
        [
            (objective, name, float(share))
            for objective, importances in shares(seen).items()
            for name, share in (importances or {}).items()
        ],
    )


def prediction(seen: ExplorationStatus, objective: str) -> Prediction | None:
    learnt = insight(seen)
    return learnt.predictions[objective] if learnt else None


def predictions_table(seen: ExplorationStatus, objective: str) -> Table:
    """The measured and the predicted values."""
    predicted = prediction(seen, objective)
    unit = formats.unit_column(objective)
    pairs = (
        []
        if predicted is None
        else zip(predicted.measured.tolist(), predicted.predicted.tolist(), strict=True)
    )
    return Table((f"measured_{unit}", f"predicted_{unit}"), list(pairs))


def _n(seen: ExplorationStatus) -> str:
    return formats.plural(seen.finished, "measurement")


def _titled(words: str, seen: ExplorationStatus) -> str:
    exploration = seen.exploration
    return f"{words}: exploration {exploration.pk} of {exploration.application}"


def _page(key: int, **_: Any) -> str:
    return reverse("dashboard:exploration", args=[key])


DRAWINGS: tuple[Drawing[Any], ...] = (
    Drawing(
        name="exploration",
        path="explorations/<int:key>",
        definition="Largest trajectory error and mean computation time a frame of every measured "
        "configuration; the median where one was measured several times.",
        read=read,
        draw=plane,
        table=points_table,
        title=lambda seen: _titled("Everything measured", seen),
        n=_n,
        page=_page,
        stamp=stamp,
        origin=UNRELEASED,
    ),
    Drawing(
        name="exploration-hypervolume",
        path="explorations/<int:key>/hypervolume",
        definition="The hypervolume: how much of a rectangle the configurations measured so far dominate. It "
        "goes from the best value of each objective found within the limits to the limits, on logarithmic "
        "axes.",
        read=read,
        draw=lambda seen, theme: growth_line(growth_of(seen), seen.phases["random"], theme),
        table=growth_table,
        title=lambda seen: _titled("How the front grew", seen),
        n=_n,
        page=_page,
        stamp=stamp,
        origin=UNRELEASED,
    ),
    Drawing(
        name="exploration-importance",
        path="explorations/<int:key>/importance",
        definition="How much of an objective's variance is lost to a random forest that no longer "
        "knows the parameter.",
        read=read,
        draw=lambda seen, theme: importance_bars(shares(seen), theme),
        table=shares_table,
        title=lambda seen: _titled("Which parameters matter", seen),
        n=_n,
        page=_page,
        stamp=stamp,
        origin=UNRELEASED,
    ),
    Drawing(
        name="exploration-predictions",
        path="explorations/<int:key>/predictions/<slug:objective>",
        definition="Each mark was predicted by the trees of a forest that were not trained on it.",
        read=read_objective,
        draw=lambda rows, theme: prediction_plane(rows[1], prediction(*rows), theme),
        table=lambda rows: predictions_table(*rows),
        title=lambda rows: _titled(f"Predicted against measured, {formats.objective(rows[1])}", rows[0]),
        n=lambda rows: _n(rows[0]),
        page=_page,
        stamp=stamp,
        origin=UNRELEASED,
    ),
)
