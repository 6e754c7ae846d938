"""In which order a table of speedups stands, and the addresses that its column heads link to."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from crowd.dashboard.confirmation import ordered
from crowd.results.reading.queries.filters import InvalidFilterError
from crowd.results.reading.rows import Speedup

DOWN = "-"  # before a column's name: largest first
DEFAULT = "-speedup"
# What each column is sorted by; None where a row has nothing there.
COLUMNS: dict[str, Callable[[Speedup], Any]] = {
    "device": lambda row: row.device.title.casefold(),
    "speedup": lambda row: row.speedup,
    "interval": lambda row: row.low,
    "sessions": lambda row: row.sessions,
    "installations": lambda row: row.installations,
    "chip": lambda row: row.processor.casefold() or None,
    "system": lambda row: row.device.os.casefold() or None,
}
WORDS = frozenset({"device", "chip", "system"})  # these begin with A, numbers with the largest


@dataclass(frozen=True)
class Order:
    """The column a table is sorted by, and whether the largest value comes first."""

    column: str
    descending: bool

    @classmethod
    def parse(cls, given: str) -> "Order":
        """The order that ?sort= names. Raises InvalidFilterError."""
        name = (given or DEFAULT).removeprefix(DOWN)
        if name not in COLUMNS:
            right = ", ".join(COLUMNS)
            raise InvalidFilterError(
                "sort", f"sort={given:.50}: give one of {right}, with - before it for descending"
            )
        return cls(name, (given or DEFAULT).startswith(DOWN))

    @property
    def text(self) -> str:
        """How ?sort= names it; "" for the default."""
        text = f"{DOWN if self.descending else ''}{self.column}"
        return "" if text == DEFAULT else text

    @property
    def aria(self) -> str:
        return "descending" if self.descending else "ascending"

    def after_click(self, column: str) -> "Order":
        """The order after a click on the head of COLUMN: the usual one first, then the reverse."""
        if column == self.column:
            return Order(column, not self.descending)
        return Order(column, column not in WORDS)

    def sort(self, rows: Iterable[Speedup]) -> tuple[Speedup, ...]:
        """ROWS in this order, equal ones as they were, those without a value last. By size, figures that
        count stand above others: anyone can send a large unconfirmed one.
        """
        value = COLUMNS[self.column]
        told = [row for row in rows if value(row) is not None]
        absent = [row for row in rows if value(row) is None]
        found = sorted(told, key=value, reverse=self.descending) + absent
        by_size = self.descending and self.column in {"speedup", "interval"}
        return ordered(found) if by_size else tuple(found)
