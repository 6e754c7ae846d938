"""The table of a drawing as LaTeX, with the rules of the package booktabs."""

import math
from collections.abc import Sequence

from crowd.dashboard.content.citation import tex
from crowd.dashboard.drawings.drawing import Cell, Table

UNITS = frozenset({"s", "m"})
DIGITS = 4  # CSV and JSON have all


def latex(table: Table, caption: str, notes: Sequence[str]) -> str:
    """`table` with `caption`, numbers rounded to DIGITS; each of `notes` is a comment above it."""
    columns = list(zip(*table.rows, strict=True)) if table.rows else [()] * len(table.columns)
    alignment = "".join("r" if _is_numeric(column) else "l" for column in columns)
    lines = [
        *(f"% {' '.join(note.split())}" for note in notes),
        r"% \usepackage{booktabs}",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{tex(caption)}}}",
        rf"\begin{{tabular}}{{{alignment}}}",
        r"\toprule",
        _row([_heading(name) for name in table.columns]),
        r"\midrule",
        *(_row([_cell(cell) for cell in row]) for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join([*lines, ""])


def _row(cells: Sequence[str]) -> str:
    return rf"{' & '.join(cells)} \\"


def _heading(name: str) -> str:
    """The words of a column's name; a unit at its end in brackets."""
    words, _, unit = name.rpartition("_")
    return tex((f"{words} ({unit})" if unit in UNITS else name).replace("_", " "))


def _is_numeric(column: Sequence[Cell]) -> bool:
    numbers = [cell for cell in column if cell is not None]
    return bool(numbers) and all(
        isinstance(cell, int | float) and not isinstance(cell, bool) for cell in numbers
    )


def _cell(cell: Cell) -> str:
    match cell:
        case None:
            return "--"
        case bool():
            return "yes" if cell else "no"
        case float():
            return _number(cell)
        case _:
            return tex(str(cell))


def _number(value: float) -> str:
    """In mathematics mode where it has a sign or an exponent."""
    if not math.isfinite(value):
        return "--"
    mantissa, exponential, power = f"{value:.{DIGITS}g}".partition("e")
    if exponential:
        return rf"${mantissa} \times 10^{{{int(power)}}}$"
    return f"${mantissa}$" if value < 0 else mantissa
