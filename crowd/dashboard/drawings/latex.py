"""The table of a drawing as LaTeX, with the rules of the package booktabs."""

import math
from collections.abc import Sequence

from crowd.dashboard.content.citation import tex
from crowd.dashboard.drawings.drawing import Cell, Table

UNITS = frozenset({"s", "m"})
DIGITS = 4  # CSV and JSON have all
ROWS = 45  # that fit a page
WORDS = {"ate": "ATE", "gpu": "GPU", "os": "system", "soc": "SoC"}


def latex(table: Table, caption: str, notes: Sequence[str]) -> str:
    """`table` with `caption`, numbers rounded to DIGITS; each of `notes` is a comment above it.

    One of more than ROWS continues on further pages.
    """
    columns = list(zip(*table.rows, strict=True)) if table.rows else [()] * len(table.columns)
    cells = [_cells(column) for column in columns] if table.rows else []
    alignment = "".join("r" if _is_numeric(column) else "l" for column in columns)
    title, comments = rf"\caption{{{tex(caption)}}}", [f"% {' '.join(note.split())}" for note in notes]
    head = [r"\toprule", _row([_heading(name) for name in table.columns]), r"\midrule"]
    body = [*map(_row, zip(*cells, strict=True)), r"\bottomrule"]
    if len(table.rows) > ROWS:
        opening = [
            r"% \usepackage{booktabs,longtable}",
            rf"\begin{{longtable}}{{{alignment}}}",
            rf"{title} \\",
        ]
        return "\n".join([*comments, *opening, *head, r"\endhead", *body, r"\end{longtable}", ""])
    opening = [r"% \usepackage{booktabs}", r"\begin{table}", r"\centering", title]
    opening += [rf"\begin{{tabular}}{{{alignment}}}"]
    return "\n".join([*comments, *opening, *head, *body, r"\end{tabular}", r"\end{table}", ""])


def _row(cells: Sequence[str]) -> str:
    return rf"{' & '.join(cells)} \\"


def _heading(name: str) -> str:
    """The words of a column's name; a unit at its end in brackets."""
    words, _, unit = name.rpartition("_")
    words = words if unit in UNITS else name
    named = " ".join(WORDS.get(word, word) for word in words.split("_"))
    return tex(f"{named} ({unit})" if unit in UNITS else named)


def _is_numeric(column: Sequence[Cell]) -> bool:
    numbers = [cell for cell in column if cell is not None]
    return bool(numbers) and all(
        isinstance(cell, int | float) and not isinstance(cell, bool) for cell in numbers
    )


def _cells(column: Sequence[Cell]) -> list[str]:
    """The cells as text. If one number of a column has all DIGITS, the others have as many."""
    finite = [cell for cell in column if isinstance(cell, float) and math.isfinite(cell)]
    padded = any("0e" not in f"{cell:.{DIGITS - 1}e}" for cell in finite)
    return [_cell(cell, padded) for cell in column]


def _cell(cell: Cell, padded: bool) -> str:
    match cell:
        case None:
            return "--"
        case bool():
            return "yes" if cell else "no"
        case float():
            return _number(cell, padded)
        case _:
            return tex(str(cell))


def _number(value: float, padded: bool) -> str:
    """In mathematics mode where it has a sign or an exponent."""
    if not math.isfinite(value):
        return "--"
    text = f"{value:#.{DIGITS}g}" if padded else f"{value:.{DIGITS}g}"
    mantissa, exponential, power = text.partition("e")
    mantissa = mantissa.removesuffix(".")
    if exponential:
        return rf"${mantissa} \times 10^{{{int(power)}}}$"
    return f"${mantissa}$" if value < 0 else mantissa
