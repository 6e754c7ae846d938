"""Which cells of place x case the normal run checks: each kernel on every place, each case on some."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable
from itertools import combinations
from operator import itemgetter
from typing import Any

import pytest

from tests import pairs

PLACE = "session"  # the fixture whose parameter is a place

Value = tuple[tuple[str, ...], tuple[int, ...]]  # of an axis: its arguments, and which objects they are
Cell = tuple[int, frozenset[Value]]  # a place, and a value of each axis


def kind_of(place: Any) -> Hashable:
    """What places that run the same text of a kernel have in common: layout, or backend, or an own build."""
    if not isinstance(place, tuple):
        return "wasm" if isinstance(place, int) else "webgpu"
    device, layout, *build = place
    return "build" if build else layout.kind if layout else device.backend


def cover(cells: dict[Cell, Hashable]) -> set[Cell]:
    """Some of `cells`, whose values are the kinds of their places.

    Each place occurs, each value of an axis with each kind of place, and each two values of two axes.
    """
    held = {cell: {("place", cell[0]), *_meetings(kind, cell[1])} for cell, kind in cells.items()}
    return pairs.cover(held, place=itemgetter(0))


def _meetings(kind: Hashable, values: Iterable[Value]) -> set[Hashable]:
    return {(kind, value) for value in values} | {frozenset(pair) for pair in combinations(values, 2)}


def cell_of(item: pytest.Function) -> Cell:
    params = item.callspec.params
    axes = [_names(mark.args[0]) for mark in item.iter_markers("parametrize")]
    axes += [(name,) for name in params.keys() - {PLACE}.union(*axes)]
    return id(params[PLACE]), frozenset((axis, tuple(id(params[name]) for name in axis)) for axis in axes)


def _names(names: str | Iterable[str]) -> tuple[str, ...]:
    return tuple(name.strip() for name in names.split(",")) if isinstance(names, str) else tuple(names)


def mark_exhaustive(items: Iterable[pytest.Item]) -> None:
    """Mark the cells of each test with a `session` that its cover does not need."""
    tests: dict[str, dict[Cell, pytest.Function]] = defaultdict(dict)
    for item in items:
        call = getattr(item, "callspec", None)
        if isinstance(item, pytest.Function) and call is not None and PLACE in call.params:
            tests[item.nodeid.partition("[")[0]][cell_of(item)] = item
    for cells in tests.values():
        kinds = {cell: kind_of(item.callspec.params[PLACE]) for cell, item in cells.items()}
        for cell in cells.keys() - cover(kinds):
            cells[cell].add_marker(pytest.mark.exhaustive)
