"""What a record says of its fields, once: the API, its pages and the open data read it off.

A record is a struct whose fields have a meaning and a unit:

    ate_max: Annotated[float | None, means("largest distance of the camera from its true place", "m")]

A field is shown at two doors: as a member of the API's JSON, and as a column of the open data. It has its own
name there, unless it says otherwise. A field without a meaning is shown nowhere.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints
from uuid import UUID

import msgspec

Door = Literal["json", "column"]
ARROW = {UUID: "string", str: "string", float: "float64", int: "int64", bool: "bool", datetime: "timestamp"}

Answer = TypeVar("Answer", bound=msgspec.Struct)


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """A row that reads return. Unknown texts are empty."""


@dataclass(frozen=True)
class Member:
    """A field at a door: its `name` there, the `attribute` that holds it, and what it is.

    `arrow` is the type of its column.
    """

    name: str
    attribute: str
    type: Any
    meaning: str
    unit: str
    arrow: str

    @property
    def nested(self) -> bool:
        """Whether CSV cannot represent its column, which then is in Parquet alone."""
        return self.arrow.startswith(("list", "map"))

    @property
    def optional(self) -> bool:
        """Whether it can be empty."""
        return type(None) in get_args(self.type)

    @property
    def annotation(self) -> Any:
        """Its type, with its meaning and unit for a schema."""
        text = f"{self.meaning}, {self.unit}" if self.unit else self.meaning
        return Annotated[self.type, msgspec.Meta(description=text)]


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


@cache
def members(record: type[Record], door: Door) -> tuple[Member, ...]:
    """What `record` shows at `door`: its fields in their order, then its properties."""
    return tuple(_members(record, door))


@cache
def answer(record: type[Record], without: tuple[str, ...] = ()) -> type[msgspec.Struct]:
    """A base for the struct of `record` as JSON, except for the members `without`."""
    shown = [member for member in members(record, "json") if member.name not in without]
    fields = [(member.name, member.annotation) for member in shown]
    return msgspec.defstruct(
        f"{record.__name__}Answer",
        fields,
        namespace={"_read": staticmethod(attrgetter(*(member.attribute for member in shown)))},
    )


def fill(struct: type[Answer], row: Record, **own: Any) -> Answer:
    """`row` as `struct`, whose base is its `answer`; `own`: the members that `struct` adds."""
    values = struct._read(row)  # type: ignore[attr-defined]
    return struct(**dict(zip(struct.__struct_fields__, values, strict=False)), **own)


@cache
def columns_of(model: Any, record: type[Record]) -> tuple[str, ...]:
    """The plain columns of the Django `model` that have the name of a field of `record`, and its value."""
    names = {field.name for field in model._meta.concrete_fields if not field.is_relation}
    return tuple(name for name in record.__struct_fields__ if name in names)


def _members(record: type[Record], door: Door) -> Iterator[Member]:
    for attribute, annotation in _annotations(record).items():
        if get_origin(annotation) is not Annotated:
            continue
        kind, meta = get_args(annotation)
        if "parts" in meta.extra:
            inner = {member.attribute: member for member in _members(kind, "json")}
            for name, part in meta.extra["parts"][door].items():
                yield replace(inner[part], name=name, attribute=f"{attribute}.{part}")
        elif (name := meta.extra["names"][door]) is not None:
            arrow = meta.extra["arrow"] or _arrow(kind)
            yield Member(name or attribute, attribute, kind, meta.extra["meaning"], meta.extra["unit"], arrow)


def _arrow(kind: Any) -> str:
    """The type of a column for `kind`, or for `kind` and None; "" where it does not follow."""
    kinds = {kind, *get_args(kind)} & ARROW.keys()
    return ARROW[kinds.pop()] if kinds else ""


def _annotations(record: type[Record]) -> dict[str, Any]:
    """The annotations of `record`'s fields, and of what its properties return."""
    getters = {name: value.fget for name, value in vars(record).items() if isinstance(value, property)}
    returned = {name: get_type_hints(read, include_extras=True)["return"] for name, read in getters.items()}
    return {field.name: field.type for field in msgspec.structs.fields(record)} | returned
