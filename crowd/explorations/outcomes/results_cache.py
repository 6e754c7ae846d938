"""Caches the results of the most recently viewed explorations in this process, so that no row is read twice.

While a search runs, its page asks for everything measured after each measurement. Any change of a finished
row changes its state, attempt, finished_at or ratio_filled_at. These four are read of all rows, and only the
rows where one differs are read again. The result is the same as after reading all rows.
"""

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from operator import attrgetter, itemgetter
from threading import Lock

from django.db import connection

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching import points
from crowd.explorations.searching.points import Point
from crowd.explorations.searching.search import CHOSEN_ONCE, FINISHED, for_search

MAX_EXPLORATIONS = 4  # explorations
MAX_KEYS = 500  # keys in a query; where more rows changed, all are read

Mark = tuple[int, str, int, str | None, str | None]  # key, state, attempt, finished_at, ratio_filled_at
# In SQL, with dates as text: converting ten thousand dates would take as long as reading them.
MARKS = f"""
    SELECT id, state, attempt, CAST(finished_at AS text), CAST(ratio_filled_at AS text)
    FROM {Evaluation._meta.db_table}
    WHERE exploration_id = %s AND state IN (%s, %s) AND phase <> %s
"""


@dataclass(frozen=True)
class SearchResults:
    """The results of an exploration: its points and front, and the measurements of the search.

    `indices`: the numbers of the searched configurations in the space. `values`: their objectives, None for a
    failure. `phases`: why they were measured. All in the order in which they finished.
    """

    points: tuple[Point, ...]
    front: tuple[Point, ...]
    indices: tuple[int, ...]
    values: tuple[dict[str, float] | None, ...]
    phases: tuple[str, ...] = ()


class ResultsCache:
    """The finished rows of one exploration, their points, and the last result.

    `_groups`: rows by configuration and key. `_points`: the number of the first measurement and the point of
    each configuration.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._marks: set[Mark] = set()
        self._rows: dict[int, Evaluation] = {}
        self._groups: dict[str, dict[int, Evaluation]] = {}
        self._points: dict[str, tuple[int, Point]] = {}
        self._answer: tuple[str, SearchResults] | None = None

    def found(self, exploration: Exploration, results: str) -> SearchResults:
        """The results of `exploration`. `results` is a digest that changes with each measurement."""
        with self._lock:
            if self._answer is None or self._answer[0] != results:
                self._read(exploration)
                self._answer = (results, self._found(exploration))
            return self._answer[1]

    def _read(self, exploration: Exploration) -> None:
        # Marks are read before the rows: a row that changes in between is read again with the next marks.
        marks = _marks(exploration)
        keys = {key for key, *_ in marks - self._marks}
        left = {key for key, *_ in self._marks - marks}
        new = _rows(exploration, keys)
        old = [self._rows.pop(key) for key in left | keys if key in self._rows]
        for row in old:
            del self._groups[row.configuration_key][row.pk]
        for row in new:
            self._rows[row.pk] = row
            self._groups.setdefault(row.configuration_key, {})[row.pk] = row
        for key in {row.configuration_key for row in (*old, *new)}:
            self._update_point(key)
        self._marks = marks

    def _update_point(self, configuration: str) -> None:
        rows = sorted(self._groups[configuration].values(), key=attrgetter("number"))
        done = [row for row in rows if row.state == Evaluation.State.DONE]
        self._points.pop(configuration, None)
        for point in points.measured_points(done):
            self._points[configuration] = (done[0].number, point)

    def _found(self, exploration: Exploration) -> SearchResults:
        measured = [point for _, point in sorted(self._points.values(), key=itemgetter(0))]
        searched = [row for row in self._rows.values() if row.index is not None and row.phase in CHOSEN_ONCE]
        searched.sort(key=lambda row: (row.finished_at or row.created_at, row.number))
        return SearchResults(
            points=tuple(measured),
            front=tuple(points.best_points(exploration, points.reliable(exploration, measured))),
            indices=tuple(row.index for row in searched if row.index is not None),
            values=tuple(row.objectives for row in searched),
            phases=tuple(row.phase for row in searched),
        )


@lru_cache(maxsize=MAX_EXPLORATIONS)
def cache_of(key: int, created_at: datetime) -> ResultsCache:  # noqa: ARG001
    """The cache of the exploration `key` in this process, empty at first."""
    return ResultsCache()


def _marks(exploration: Exploration) -> set[Mark]:
    with connection.cursor() as cursor:
        cursor.execute(MARKS, [exploration.pk, *FINISHED, Evaluation.Phase.PRIOR])
        return set(cursor.fetchall())


def _rows(exploration: Exploration, keys: Collection[int]) -> list[Evaluation]:
    finished = Evaluation.objects.filter(exploration=exploration, state__in=FINISHED).order_by()
    finished = finished.exclude(phase=Evaluation.Phase.PRIOR)
    if len(keys) <= MAX_KEYS:
        finished = finished.filter(pk__in=keys)
    return [row for row in for_search(finished) if row.pk in keys]
