"""What this process has read of the explorations that were looked at last, so that no row is read twice.

While a search runs, its page asks for everything measured after each measurement. Any change of a finished
row changes its state, attempt, finished_at or ratio_filled_at. These four are read of all rows, and only the
rows where one differs are read again. The answer is the same as after reading all rows.
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
from crowd.explorations.searching.points import Point, Row
from crowd.explorations.searching.search import CHOSEN_ONCE, FINISHED

MOST_KEPT = 4  # explorations
MOST_NAMED = 500  # keys in a query; where more rows changed, all are read
COLUMNS = tuple("index" if name == "place" else name for name in Row._fields)

Mark = tuple[int, str, int, str | None, str | None]  # key, state, attempt, finished_at, ratio_filled_at
# Written out, and the dates as text: to convert ten thousand of them would take as long as to read them.
MARKS = f"""
    SELECT id, state, attempt, CAST(finished_at AS text), CAST(ratio_filled_at AS text)
    FROM {Evaluation._meta.db_table}
    WHERE exploration_id = %s AND state IN (%s, %s) AND phase <> %s
"""


@dataclass(frozen=True)
class Found:
    """What an exploration measured: its points and front, and the search's measurements in order.

    `indices` places each searched evaluation in the space, `values` has its objectives (None: it failed),
    both in the order in which they were finished.
    """

    points: tuple[Point, ...]
    front: tuple[Point, ...]
    indices: tuple[int, ...]
    values: tuple[dict[str, float] | None, ...]


class Reading:
    """The finished rows of one exploration, the points that they make, and the answer that was given last.

    `_groups` has the rows by configuration and key; `_points` each configuration's point behind the number
    of its first measurement.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._marks: set[Mark] = set()
        self._rows: dict[int, Row] = {}
        self._groups: dict[str, dict[int, Row]] = {}
        self._points: dict[str, tuple[int, Point]] = {}
        self._answer: tuple[str, Found] | None = None

    def found(self, exploration: Exploration, results: str) -> Found:
        """What EXPLORATION has measured. RESULTS is a digest that is another one after each measurement."""
        with self._lock:
            if self._answer is None or self._answer[0] != results:
                self._read(exploration)
                self._answer = (results, self._found(exploration))
            return self._answer[1]

    def _read(self, exploration: Exploration) -> None:
        # Marks are read before the rows: whatever changes between is read as it is by then, and once more
        # when the next marks tell of it.
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
            self._tell(key)
        self._marks = marks

    def _tell(self, configuration: str) -> None:
        rows = sorted(self._groups[configuration].values(), key=attrgetter("number"))
        done = [row for row in rows if row.state == Evaluation.State.DONE]
        self._points.pop(configuration, None)
        for point in points.measured(done):
            self._points[configuration] = (done[0].number, point)

    def _found(self, exploration: Exploration) -> Found:
        known = [point for _, point in sorted(self._points.values(), key=itemgetter(0))]
        searched = [row for row in self._rows.values() if row.place is not None and row.phase in CHOSEN_ONCE]
        searched.sort(key=lambda row: (row.finished_at or row.created_at, row.number))
        return Found(
            points=tuple(known),
            front=tuple(points.front(exploration, points.settled(exploration, known))),
            indices=tuple(row.place for row in searched if row.place is not None),
            values=tuple(row.objectives for row in searched),
        )


@lru_cache(maxsize=MOST_KEPT)
def kept(key: int, created_at: datetime) -> Reading:  # noqa: ARG001
    """The reading of that exploration which this process keeps, an empty one at first."""
    return Reading()


def _marks(exploration: Exploration) -> set[Mark]:
    with connection.cursor() as cursor:
        cursor.execute(MARKS, [exploration.pk, *FINISHED, Evaluation.Phase.PRIOR])
        return set(cursor.fetchall())


def _rows(exploration: Exploration, keys: Collection[int]) -> list[Row]:
    rows = Evaluation.objects.filter(exploration=exploration, state__in=FINISHED).order_by()
    rows = rows.exclude(phase=Evaluation.Phase.PRIOR)
    if len(keys) <= MOST_NAMED:
        return [Row._make(values) for values in rows.filter(pk__in=keys).values_list(*COLUMNS)]
    return [row for row in map(Row._make, rows.values_list(*COLUMNS)) if row.pk in keys]
