"""pandas DataFrames in and out of an explorer: a column for each parameter and each objective."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pareto.errors import ObjectiveError
from pareto.fronts.censored import CENSORED, censored_names, mark_censored
from pareto.fronts.objective import Objective
from pareto.spaces.space import Configuration, Space

if TYPE_CHECKING:
    from pandas import DataFrame

Row = tuple[Mapping[str, Any], Mapping[str, Any] | None]


def columns(space: Space, objectives: Iterable[Objective]) -> list[str]:
    """Return the names of parameters and objectives, in order.

    Raises ObjectiveError for an objective with a parameter's name, which would share its column, and for the
    name `censored`.
    """
    names = [objective.name for objective in objectives]
    if shared := [name for name in names if name in space.names]:
        raise ObjectiveError(
            f"objective {shared[0]!r} has the name of a parameter, and in a CSV file both would be one "
            "column: rename one of them"
        )
    if CENSORED in (*space.names, *names):
        raise ObjectiveError(
            f"{CENSORED!r} is the column that names the values which are only bounds: give the parameter or "
            "objective another name"
        )
    return [*space.names, *names]


def read_frame(frame: DataFrame, space: Space, objectives: Iterable[Objective]) -> list[Row]:
    """Return (configuration, values or None) for each row of `frame`, in order.

    A row in which a value is missing (NaN, None, NA) is a failed measurement. A parameter may be missing
    where it is inactive. A column `censored` names the objectives whose value is a bound, as that of
    `write_frame`. Further columns are ignored. Raises ObjectiveError for what is not a DataFrame, or lacks a
    column or has it twice, or for a wrong name in `censored`.
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
    marks, known = [""] * len(frame), [str(name) for name in frame.columns]
    if CENSORED in frame.columns:
        marks = [cells[CENSORED] or "" for cells in _records(frame, [CENSORED])]
    rows = zip(_records(frame, space.names), _records(frame, names), marks, strict=True)
    try:
        return [
            (configuration, None if None in values.values() else mark_censored(values, mark, known))
            for configuration, values, mark in rows
        ]
    except ValueError as error:
        raise ObjectiveError(str(error)) from error


def write_frame(
    space: Space,
    objectives: Iterable[Objective],
    rows: Iterable[tuple[Configuration, Mapping[str, float] | None]],
) -> DataFrame:
    """Return a row for each of `rows`; values that failed are NaN, inactive parameters missing.

    Where a value is a bound, a column `censored` names such objectives of each row.
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
    marks = [censored_names(values) for _, values in rows]
    return pd.DataFrame(frame | ({CENSORED: marks} if any(marks) else {}))


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
