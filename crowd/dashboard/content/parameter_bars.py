"""Configurations by their parameters: a row per configuration, a small bar per value."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from crowd.dashboard import formats

WHOLE = 100  # per cent of a bar


@dataclass(frozen=True)
class Row:
    """A configuration with its time per frame (s), its largest error (m) and its parameters.

    `measurements`: the number of measurements behind it, None if not shown.
    """

    name: str
    runtime: float | None
    ate_max: float | None
    parameters: Mapping[str, Any]
    measurements: int | None = None


@dataclass(frozen=True)
class Bar:
    """A value and the width of its bar in per cent: its rank among the values that occur.

    `mark`: the width for the default's value, None if the default has none. `usual`: the value is the
    default's.
    """

    text: str
    width: int
    mark: int | None
    usual: bool


@dataclass(frozen=True)
class ParameterBars:
    """The parameters that differ, and rows with a bar for each of them (None: not set).

    `same`: parameters with one value everywhere, also in the default configuration.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[Row, tuple[Bar | None, ...]], ...]
    same: Mapping[str, Any]


def parameter_bars(rows: Iterable[Row], default: Mapping[str, Any] | None) -> ParameterBars:
    """The bars of `rows`, fastest first, with marks for the values of `default`."""
    rows = sorted(rows, key=lambda row: (row.runtime is None, row.runtime or 0.0))
    usual = default or {}
    every = list(dict.fromkeys(name for row in rows for name in row.parameters))
    values = {name: _occurring([usual, *(row.parameters for row in rows)], name) for name in every}
    same = {
        name: distinct[0]
        for name, distinct in values.items()
        if len(distinct) == 1 and all(name in row.parameters for row in rows)
    }
    names = tuple(name for name in every if name not in same)
    return ParameterBars(
        names=names,
        rows=tuple(
            (row, tuple(_bar(row.parameters, name, values[name], usual) for name in names)) for row in rows
        ),
        same=same,
    )


def _bar(
    parameters: Mapping[str, Any], name: str, values: Sequence[Any], default: Mapping[str, Any]
) -> Bar | None:
    if name not in parameters:
        return None
    value = parameters[name]
    mark = _width(values, default[name]) if default.get(name) in values else None
    return Bar(_short(value), _width(values, value), mark, name in default and value == default[name])


def _width(values: Sequence[Any], value: Any) -> int:
    return round(WHOLE * (values.index(value) + 1) / len(values))


def _occurring(parameters: Sequence[Mapping[str, Any]], name: str) -> list[Any]:
    """The distinct values of `name`: numbers ascending, then texts."""
    distinct = {row[name] for row in parameters if name in row}
    return sorted(distinct, key=lambda value: (isinstance(value, str), _number(value), str(value)))


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _short(value: object) -> str:
    """`value` with three significant digits, to fit into a column."""
    return f"{value:.3g}" if isinstance(value, float) else formats.parameter(value)
