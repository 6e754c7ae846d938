"""pandas DataFrames in and out of an explorer: a column for each parameter and each objective."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pareto.errors import ObjectiveError
from pareto.fronts.objective import Objective
from pareto.spaces.space import Configuration, Space

if TYPE_CHECKING:
    from pandas import DataFrame

Row = tuple[Mapping[str, Any], Mapping[str, Any] | None]


def columns(space: Space, objectives: Iterable[Objective]) -> list[str]:
    """Return the names of parameters and objectives, in order.

    Raises ObjectiveError for an objective with a parameter's name: they would share a column.
    """
    names = [objective.name for objective in objectives]
    if shared := [name for name in names if name in space.names]:
        raise ObjectiveError(
            f"objective {shared[0]!r} has the name of a parameter, and in a CSV file both would be one "
            "column: rename one of them"
        )
    return [*space.names, *names]


def read_frame(frame: DataFrame, space: Space, objectives: Iterable[Objective]) -> list[Row]:
    """Return (configuration, values or None) for each row of `frame`, in order.

    A row in which a value is missing (NaN, None, NA) is a failed measurement. A parameter may be missing
    where it is inactive. Further columns are ignored. Raises ObjectiveError for what is not a DataFrame, or
    lacks a column or has it twice.
    """
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise ObjectiveError(f"tell_frame takes a pandas DataFrame, not {type(frame).__name__}")
    objectives = tuple(objectives)
    for name in columns(space, objectives):
        if (times := list(frame.columns).count(name)) != 1:
            many = "more than one" if times else "no"
            raise ObjectiveError(
                f"the frame has {many} column {name!r}: it has {', '.join(map(str, frame.columns))}"
            )
    names = [objective.name for objective in objectives]
    return [
        (configuration, None if any(value is None for value in values.values()) else values)
        for configuration, values in zip(_records(frame, space.names), _records(frame, names), strict=True)
    ]


def write_frame(
    space: Space,
    objectives: Iterable[Objective],
    rows: Iterable[tuple[Configuration, Mapping[str, float] | None]],
) -> DataFrame:
    """Return a row for each of `rows`; values that failed are NaN, inactive parameters missing.

    A censored value is its bound.

    Columns of whole numbers stay whole (Int64 where a value is missing).
    """
    import pandas as pd

    rows = list(rows)
    frame: dict[str, Any] = {}
    for item in space.parameters:
        column = pd.Series([point[item.name] for point, _ in rows], dtype=object)
        frame[item.name] = column.convert_dtypes() if column.isna().any() else column.infer_objects()
    for objective in objectives:
        frame[objective.name] = pd.Series(
            [None if values is None else values[objective.name] for _, values in rows], dtype="float64"
        )
    return pd.DataFrame(frame)


def _records(frame: DataFrame, names: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Yield the cells of each row by column, as Python's own values; None where one is missing."""
    import pandas as pd

    names = list(names)
    cells = [
        [None if missing else value for value, missing in zip(frame[name], pd.isna(frame[name]), strict=True)]
        for name in names
    ]
    for values in zip(*cells, strict=True):
        yield dict(zip(names, values, strict=True))
