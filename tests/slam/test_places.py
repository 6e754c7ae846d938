"""The cover of place x case leaves out no kernel on a place, no value and no two values together."""

from __future__ import annotations

from itertools import product

from tests.slam.places import Cell, Value, cover

KINDS = {0: "rows", 1: "pixels", 2: "build", 3: "build"}


def cells(*axes: tuple[Value, ...]) -> dict[Cell, str]:
    return {(place, frozenset(values)): kind for place, kind in KINDS.items() for values in product(*axes)}


def axis(name: str, count: int) -> tuple[Value, ...]:
    return tuple(((name,), (number,)) for number in range(count))


def test_each_case_meets_each_kind_of_place_and_every_place_has_one():
    cases = axis("case", 5)
    chosen = cover(cells(cases))

    assert {place for place, _ in chosen} == set(KINDS)
    met = {(KINDS[place], value) for place, values in chosen for value in values}
    assert met == set(product(KINDS.values(), cases))
    assert len(chosen) == 5 * 3


def test_each_two_values_of_two_axes_meet_somewhere():
    cameras, twists = axis("camera", 2), axis("twist", 3)
    chosen = cover(cells(cameras, twists))

    assert {values for _, values in chosen} == set(map(frozenset, product(cameras, twists)))
    assert len(chosen) < len(cells(cameras, twists))


def test_of_a_test_without_cases_every_place_is_kept():
    assert cover(cells()) == set(cells())
