"""Sorting of a table of speedups by its column heads."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from crowd.dashboard.content.confirmation import confirmed_first
from crowd.records.speedup import Speedup
from crowd.results.reading.queries.filters import InvalidFilterError

DOWN = "-"  # before the name of a column: descending
DEFAULT = "-speedup"
# The sort key of each column; None without a value.
COLUMNS: dict[str, Callable[[Speedup], Any]] = {
    "device": lambda row: row.device.title.casefold(),
    "speedup": lambda row: row.speedup,
    "interval": lambda row: row.low,
    "sessions": lambda row: row.sessions,
    "installations": lambda row: row.installations,
    "chip": lambda row: row.processor.casefold() or None,
    "system": lambda row: row.device.os.casefold() or None,
}
WORDS = frozenset({"device", "chip", "system"})  # ascending by default; numbers are descending


@dataclass(frozen=True)
class Order:
    """The column that a table is sorted by, and the direction."""

    column: str
    descending: bool

    @classmethod
    def parse(cls, given: str) -> "Order":
        """Parse ?sort=. Raises InvalidFilterError."""
        name = (given or DEFAULT).removeprefix(DOWN)
        if name not in COLUMNS:
            right = ", ".join(COLUMNS)
            raise InvalidFilterError(
                "sort", f"sort={given:.50}: give one of {right}, with - before it for descending"
            )
        return cls(name, (given or DEFAULT).startswith(DOWN))

    @property
    def text(self) -> str:
        """The value for ?sort=; "" for the default."""
        text = f"{DOWN if self.descending else ''}{self.column}"
        return "" if text == DEFAULT else text

    @property
    def aria(self) -> str:
        return "descending" if self.descending else "ascending"

    def after_click(self, column: str) -> "Order":
        """The order after a click on the head of `column`; a second click reverses it."""
        if column == self.column:
            return Order(column, not self.descending)
        return Order(column, column not in WORDS)

    def sort(self, rows: Iterable[Speedup]) -> tuple[Speedup, ...]:
        """`rows` in this order (stable), those without a value last.

        In descending order of size, counted figures come first, because anyone can send a large unconfirmed
        one.
        """
        value = COLUMNS[self.column]
        present = [row for row in rows if value(row) is not None]
        absent = [row for row in rows if value(row) is None]
        ordered = sorted(present, key=value, reverse=self.descending) + absent
        by_size = self.descending and self.column in {"speedup", "interval"}
        return confirmed_first(ordered) if by_size else tuple(ordered)
