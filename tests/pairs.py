"""A part of a grid in which each value of an axis meets each value of every other axis."""

import itertools
from collections.abc import Sequence
from typing import Any

import pytest

Cell = tuple[int, ...]


def pairs(*axes: Sequence[Any]) -> list[Any]:
    """The whole grid of three `axes` or more, for `pytest.mark.parametrize`.

    Cells that a cover of all pairs of values does not need are marked `exhaustive`. The cover is greedy: the
    same axes give the same cover. A value may be a pytest.param with an id.
    """
    grid = list(itertools.product(*(range(len(axis)) for axis in axes)))
    chosen = _cover(grid)
    return [_param(axes, cell, exhaustive=cell not in chosen) for cell in grid]


def _cover(grid: list[Cell]) -> set[Cell]:
    """Cells of `grid` that hold each pair of values which one of its cells holds."""
    held = {cell: set(itertools.combinations(enumerate(cell), 2)) for cell in grid}
    waiting = set().union(*held.values())
    chosen = set()
    while waiting:
        best = max(grid, key=lambda cell: len(waiting & held[cell]))  # the first of equals
        waiting -= held[best]
        chosen.add(best)
    return chosen


def _param(axes: Sequence[Sequence[Any]], cell: Cell, exhaustive: bool) -> Any:
    values, names = [], []
    for axis, index in zip(axes, cell, strict=True):
        value = axis[index] if hasattr(axis[index], "marks") else pytest.param(axis[index])
        values.extend(value.values)
        names.append(value.id or _name(value.values, index))
    return pytest.param(*values, id="-".join(names), marks=[pytest.mark.exhaustive] if exhaustive else [])


def _name(values: Sequence[Any], index: int) -> str:
    plain = all(isinstance(value, str | int | float | None) for value in values)
    return "-".join(map(str, values)) if plain else str(index)
