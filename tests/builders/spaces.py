"""Spaces told by the values of their parameters, for tests of searches."""

from collections.abc import Sequence
from typing import Any

from pareto.spaces.space import Space

Values = range | tuple[float, float] | type[bool] | Sequence[Any] | dict[str, Any]


def parameter(values: Values, **more: Any) -> dict[str, Any]:
    """The fields of a parameter of these values, and `more`.

    A range is of whole numbers, a pair the bounds of reals, `bool` a boolean; listed numbers are ordinal,
    other lists categorical. A dict already has its fields.
    """
    if isinstance(values, dict):
        return values | more
    if values is bool:
        return {"type": "boolean"} | more
    if isinstance(values, range):
        return {"type": "integer", "minimum": values[0], "maximum": values[-1]} | more
    if isinstance(values, tuple):
        return {"type": "real", "minimum": values[0], "maximum": values[1]} | more
    ordered = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return {"type": "ordinal" if ordered else "categorical", "values": list(values)} | more


def described(*constraints: str, **parameters: Values) -> dict[str, Any]:
    """A space as its file has it."""
    fields: dict[str, Any] = {
        "parameters": [{"name": name} | parameter(values) for name, values in parameters.items()]
    }
    return fields | ({"constraints": list(constraints)} if constraints else {})


def space_of(*constraints: str, **parameters: Values) -> Space:
    """The space of `parameters` that `constraints` allow."""
    return Space.from_dict(described(*constraints, **parameters))
