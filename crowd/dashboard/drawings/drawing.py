"""A drawing: data that is served as a figure, as a table of numbers, and as a page to embed.

A Drawing has five addresses with the same path and query: the figure for the script that draws it
(/figures/<path>.json), its numbers (/tables/<path>.csv, .json and .tex), and a page to embed
(/embed/<path>/).
`serving` answers them; the template tag `chart` links to them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from operator import attrgetter
from typing import Any, Generic, TypeVar

from plotly import graph_objects as go

from crowd.dashboard.content.citation import RELEASED, SHIPPED
from crowd.dashboard.figures.bar_picture import BarPicture
from crowd.dashboard.figures.palette import Theme
from crowd.demo.mark import is_demo
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.results.reading.queries.filters import SpeedupFilters

Rows = TypeVar("Rows")
Cell = str | float | int | bool | None


@dataclass(frozen=True)
class Table:
    """The numbers of a figure, unrounded, in SI units.

    Column names end with the unit: runtime_s, ate_max_m.
    """

    columns: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]

    @classmethod
    def of(cls, rows: Iterable[object], *columns: str) -> "Table":
        """A row for each of `rows`, of its attributes: `speedup`, or `column=attribute.of.attribute`."""
        named = [column.partition("=") for column in columns]
        cells_of = attrgetter(*(path or name for name, _, path in named))
        return cls(tuple(name for name, *_ in named), [tuple(map(_cell, cells_of(row))) for row in rows])


def _cell(value: Any) -> Cell:
    return value.isoformat() if isinstance(value, datetime) else value


def _identity(rows: Rows) -> Rows:
    return rows


@dataclass(frozen=True, kw_only=True)
class Drawing(Generic[Rows]):
    """Functions that read rows, and show them in several ways.

    read(request, **path_arguments): the rows. Raises Http404; InvalidFilterError or InvalidComparisonError
    for an invalid query. stamp(request, **path_arguments): a cheap cache key that changes with the rows;
    figures are cached under it for a minute. page(**path_arguments): the page with the figure, under the same
    query. embedded(rows): the rows that other sites show. finding(rows): what they show, in one sentence.
    picture(rows): the chart as the server draws it for pages; the figure is then only for files. heat:
    whether it is a heat map. origin: where its data are, as a citation of its page says. paper: the columns
    of the table as LaTeX; by default all. columns: what columns of the table mean, unless `definition` says
    it.
    """

    name: str
    path: str
    definition: str
    columns: str = ""
    read: Callable[..., Rows]
    draw: Callable[[Rows, Theme], go.Figure]
    table: Callable[[Rows], Table]
    title: Callable[[Rows], str]
    n: Callable[[Rows], str]
    page: Callable[..., str]
    stamp: Callable[..., object] | None = None
    finding: Callable[[Rows], str] | None = None
    picture: Callable[[Rows], BarPicture] | None = None
    heat: bool = False
    origin: str = RELEASED
    paper: tuple[str, ...] = ()
    embedded: Callable[[Rows], Rows] = _identity

    @property
    def simulated(self) -> bool:
        """Whether its numbers are those of devices that do not exist."""
        return is_demo() and self.origin != SHIPPED

    @property
    def definition_of_table(self) -> str:
        """The definition, with what the columns mean."""
        return f"{self.definition} {self.columns}".rstrip()

    def paper_table(self, rows: Rows) -> Table:
        """The table with the columns that fit on paper."""
        table = self.table(rows)
        places = [table.columns.index(name) for name in self.paper or table.columns]
        return Table(self.paper or table.columns, [[row[place] for place in places] for row in table.rows])

    def heading(self, rows: Rows) -> tuple[str, str]:
        """The large line above a saved or embedded figure, and the one after it, which may be empty."""
        title = self.title(rows)
        return (title, "") if self.finding is None else (self.finding(rows), title)


def with_query(address: str, query: str) -> str:
    """`address` with the query string `query`, if any."""
    return f"{address}?{query}" if query else address


def titled(words: str, front: str | None, filters: SpeedupFilters) -> str:
    """A title from `words`, the `front` and the `filters`."""
    # The name of the front contains the application.
    left = replace(filters, front="", application=DEFAULT_APPLICATION)
    parts = [words, f"front {front}" if front else "", left.describe()]
    return ", ".join(filter(None, parts))
