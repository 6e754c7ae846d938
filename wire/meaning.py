"""What a field means, beside its type: the API, its pages, open data and exports read it off.

    ate_max: Annotated[float | None, means("largest distance of the camera from its true place", "m")]

A field is shown at two doors: as a member of the API's JSON, and as a column of tables. It has its own name
there, unless it says otherwise. A field without a meaning is shown nowhere.
"""

from collections.abc import Mapping

import msgspec


def means(
    meaning: str, unit: str = "", *, json: str | None = "", column: str | None = "", arrow: str = ""
) -> msgspec.Meta:
    """The `meaning` and `unit` of a field. JSON, `column`: its name at that door, None where it is not shown.

    `arrow`: the type of its column, where it does not follow from that of the field.
    """
    names = {"json": json, "column": column}
    return msgspec.Meta(extra={"meaning": meaning, "unit": unit, "arrow": arrow, "names": names})


def shows(*, json: Mapping[str, str], column: Mapping[str, str]) -> msgspec.Meta:
    """Of a field that is a record: those of its fields that are shown at each door, as {name: field}."""
    return msgspec.Meta(extra={"parts": {"json": json, "column": column}})
