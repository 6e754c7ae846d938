"""A part of a grid in which each value of an axis meets each value of every other axis."""

import itertools
from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, TypeVar

import pytest

Cell = tuple[int, ...]
Key = TypeVar("Key", bound=Hashable)


def pairs(*axes: Sequence[Any]) -> list[Any]:
    """The whole grid of three `axes` or more, for `pytest.mark.parametrize`.

    Cells that a cover of all pairs of values does not need are marked `exhaustive`: the same of the same
    axes. A value may be a pytest.param with an id.
    """
    grid = list(itertools.product(*(range(len(axis)) for axis in axes)))
    chosen = cover({cell: set(itertools.combinations(enumerate(cell), 2)) for cell in grid})
    return [_param(axes, cell, exhaustive=cell not in chosen) for cell in grid]


def cover(held: Mapping[Key, set[Hashable]], place: Callable[[Key], Hashable] = lambda _: None) -> set[Key]:
    """Some keys of `held` whose values together are those of all.

    It is greedy: next is the key with most that is missing, of equals one at the `place` with fewest so far,
    of these the first.
    """
    missing: set[Hashable] = set().union(*held.values())
    chosen: set[Key] = set()
    used: Counter[Hashable] = Counter()
    while missing:
        best = max(held, key=lambda key: (len(missing & held[key]), -used[place(key)]))
        missing -= held[best]
        chosen.add(best)
        used[place(best)] += 1
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
