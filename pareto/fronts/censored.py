"""Measurements that ended early: only a bound of their value is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

CENSORED = "censored"  # the column that names the objectives of a row whose values are bounds


class Censored(float):
    """A measured value that is known to be this or worse (right-censored).

    Worse is larger for an objective that is minimised, smaller for one that is maximised. As a number it is
    the bound.
    """

    def __repr__(self) -> str:
        return f"Censored({float(self)!r})"


def censored_names(values: Mapping[str, float] | None) -> str:
    """Return the text of the column CENSORED for a row: names separated by commas, often none."""
    return ",".join(name for name, value in (values or {}).items() if isinstance(value, Censored))


def mark_censored(values: Mapping[str, float], cell: str, columns: Iterable[str] = ()) -> dict[str, float]:
    """Return `values` with Censored ones for the names in a `cell` of the column CENSORED.

    It may name other `columns`, too. Raises ValueError for a text that names anything else.
    """
    rest, named = f",{cell},", set()
    for name in sorted({*values, *columns}, key=len, reverse=True):  # a name may hold a comma itself
        if name and f",{name}," in rest:
            rest = rest.replace(f",{name},", ",,")
            named.add(name)
    if unknown := rest.strip(", "):
        raise ValueError(
            f"{CENSORED} is {unknown!r}: this column names the objectives whose value is only a bound, with "
            "commas between them; give a column that means something else another name"
        )
    return {name: Censored(value) if name in named else value for name, value in values.items()}
