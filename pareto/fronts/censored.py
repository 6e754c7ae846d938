"""Measurements that ended early: only a bound of their value is known."""

from __future__ import annotations


class Censored(float):
    """A measured value that is known to be this or worse (right-censored).

    Worse is larger for an objective that is minimised, smaller for one that is maximised. As a number it is
    the bound.
    """

    def __repr__(self) -> str:
        return f"Censored({float(self)!r})"
