"""A drawing: one thing that can be seen as a figure, as a table of numbers, and on other people's pages.

From one Drawing come four addresses with the same path and the same query: the figure for the script that
draws it (/figures/<path>.json), its numbers (/tables/<path>.csv and .json), and a page to embed
(/embed/<path>/); `serving` answers them, the template tag `chart` links to all four.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from plotly import graph_objects as go

from crowd.dashboard.palette import Theme
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.results.reading.queries.filters import SpeedupFilters

Rows = TypeVar("Rows")
Cell = str | float | int | bool | None


@dataclass(frozen=True)
class Table:
    """What a figure shows, as numbers: SI units, unrounded. The names of columns end in the unit (runtime_s,
    ate_max_m) where there is one.
    """

    columns: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]


def _never(_: object) -> bool:
    return False


def _same(rows: Rows) -> Rows:
    return rows


@dataclass(frozen=True, kw_only=True)
class Drawing(Generic[Rows]):
    """Each of the functions answers one question about the same rows.

    read(request, **arguments of the path) may raise Http404, and InvalidFilterError or InvalidComparisonError
    for a query that cannot be understood. stamp(request, **arguments) is much cheaper to ask for and changes
    with the rows: a figure that is drawn is kept under it, for a minute. page(**arguments) is the page that
    shows the figure, under the same query. simulated(rows) says that nobody measured them: every answer says
    so. embedded(rows) is what a page of another site shows of them. finding(rows) says in one sentence what
    they show.
    """

    name: str
    path: str
    definition: str
    read: Callable[..., Rows]
    draw: Callable[[Rows, Theme], go.Figure]
    table: Callable[[Rows], Table]
    title: Callable[[Rows], str]
    n: Callable[[Rows], str]
    page: Callable[..., str]
    stamp: Callable[..., object] | None = None
    finding: Callable[[Rows], str] | None = None
    simulated: Callable[[Rows], bool] = _never
    embedded: Callable[[Rows], Rows] = _same

    def heading(self, rows: Rows) -> tuple[str, str]:
        """The large line above a saved or embedded figure, and the one after it, which may be empty."""
        title = self.title(rows)
        return (title, "") if self.finding is None else (self.finding(rows), title)


def with_query(address: str, query: str) -> str:
    """ADDRESS under the filters that QUERY names."""
    return f"{address}?{query}" if query else address


def titled(words: str, front: str | None, filters: SpeedupFilters) -> str:
    """A title: WORDS, the FRONT that is shown, and what FILTERS leave of the crowd."""
    # The front's name says which application it is.
    left = replace(filters, front="", application=DEFAULT_APPLICATION)
    parts = [words, f"front {front}" if front else "", left.describe()]
    return ", ".join(filter(None, parts))
