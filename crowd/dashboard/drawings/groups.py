"""Breakdowns of the crowd: by chip maker, backend, system on a chip, and operating system."""

from dataclasses import dataclass

from django.http import Http404, HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.drawings.drawing import Drawing, Table, titled
from crowd.dashboard.figures.groups import group_bars
from crowd.results.reading import selectors as results
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.rows import BreakdownRow, ModelOutcomes
from crowd.results.reading.selectors import Speedups

# Criteria, with their names on pages.
CRITERIA = {"vendor": "chip maker", "backend": "backend", "soc": "SoC", "os": "system"}
UNKNOWN = "unknown"
OUTCOMES = ("attempted", "failing", "losing")
NO_OUTCOMES = ModelOutcomes(devices=0, failing=0, losing=0)


@dataclass(frozen=True)
class Breakdown:
    """The groups of `crowd` by a criterion that have a counted figure, those with most models first."""

    crowd: Speedups
    by: str

    @property
    def rows(self) -> tuple[BreakdownRow, ...]:
        """What is not known comes last."""
        counted = (row for row in self.crowd.breakdowns[self.by] if row.figure.devices)
        return tuple(sorted(counted, key=lambda row: not row.group))

    def outcomes(self, group: str) -> ModelOutcomes:
        """On how many models the configuration did not finish or lost the camera."""
        return self.crowd.outcome_breakdowns[self.by].get(group, NO_OUTCOMES)

    def name(self, group: str) -> str:
        """The name of `group` on pages."""
        return BACKENDS.get(group, group) if self.by == "backend" else group or UNKNOWN


def read(request: HttpRequest, by: str) -> Breakdown:
    """The groups by `by` under the filters of the query string. Raises Http404 for an unknown criterion."""
    if by not in CRITERIA:
        raise Http404
    return Breakdown(results.speedups(results.parse_filters(request.GET)), by)


def _table(shown: Breakdown) -> Table:
    return Table(
        (shown.by, "mean_speedup", "low", "high", "median", "models", "others", *OUTCOMES),
        [
            (
                shown.name(row.group), row.figure.mean, row.figure.low, row.figure.high, row.figure.median,
                row.figure.devices, row.figure.unconfirmed, *_outcome_cells(shown.outcomes(row.group)),
            )
            for row in shown.rows
        ],
    )  # fmt: skip


def _outcome_cells(outcomes: ModelOutcomes) -> tuple[int, int | None, int | None]:
    """The cells of OUTCOMES: without an attempt, failures are not known."""
    return (outcomes.devices, *((outcomes.failing, outcomes.losing) if outcomes.devices else (None, None)))


DRAWINGS = (
    Drawing(
        name="groups",
        path="speedups/by/<slug:by>",
        definition="Geometric mean of the speedups over the device models of each group that have a "
        "confirmed figure; a model far from all others counts like the nearest. Intervals: 95 % for the mean "
        "of these models, from three models on.",
        columns="low and high: the interval. others: models that are unconfirmed or suspect. failing and "
        "losing: of the attempted models, those where the configuration did not finish, or lost the camera.",
        read=read,
        draw=lambda shown, theme: group_bars([(shown.name(row.group), row) for row in shown.rows], theme),
        table=_table,
        title=lambda shown: titled(
            f"Speedup by {CRITERIA[shown.by]}", shown.crowd.front, shown.crowd.filters
        ),
        n=lambda shown: formats.plural(shown.crowd.headline.devices, "device model"),
        page=lambda by: reverse("dashboard:devices"),  # noqa: ARG005
    ),
)
