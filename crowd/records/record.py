"""What the fields of a record mean (wire/meaning.py), at the doors where they are shown."""

from collections.abc import Iterator
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


@cache
def members(record: type[msgspec.Struct], door: Door) -> tuple[Member, ...]:
    """What `record` shows at `door`: its fields in their order, then its properties."""
    return tuple(_members(record, door))


@cache
def answer(
    record: type[msgspec.Struct], without: tuple[str, ...] = (), base: type[msgspec.Struct] = msgspec.Struct
) -> type[msgspec.Struct]:
    """A base for the struct of `record` as JSON, except for the members `without`.

    It adds what it lacks to `base`, an answer with other members of `record`.
    """
    left_out = {*without, *base.__struct_fields__}
    shown = [member for member in members(record, "json") if member.name not in left_out]
    read = attrgetter(*(member.attribute for member in shown))

    def values(row: Any) -> dict[str, Any]:
        inherited: dict[str, Any] = base._read(row) if hasattr(base, "_read") else {}
        return inherited | dict(zip((member.name for member in shown), read(row), strict=True))

    return msgspec.defstruct(
        f"{record.__name__}Answer",
        [(member.name, member.annotation) for member in shown],
        bases=(base,),
        namespace={"_read": staticmethod(values)},
    )


def fill(struct: type[Answer], row: Any, **own: Any) -> Answer:
    """`row` as `struct`, whose base is its `answer`; `own`: the members that `struct` adds or changes."""
    return struct(**struct._read(row) | own)  # type: ignore[attr-defined]


@cache
def columns_of(model: Any, struct: type[msgspec.Struct]) -> tuple[str, ...]:
    """The plain columns of the Django `model` that have the name of a field of `struct`, and its value."""
    fields = model._meta.concrete_fields
    names = {field.name for field in fields if not field.is_relation and not field.primary_key}
    return tuple(name for name in struct.__struct_fields__ if name in names)


def values_of(row: object, columns: tuple[str, ...], **own: Any) -> dict[str, Any]:
    """The values of `row` for `columns`, and those that differ from it or that it lacks."""
    return {name: getattr(row, name) for name in columns} | own


def _members(record: type[msgspec.Struct], door: Door) -> Iterator[Member]:
    for attribute, annotation in _annotations(record).items():
        if get_origin(annotation) is not Annotated:
            continue
        kind, *metas = get_args(annotation)
        extra = next((meta.extra for meta in metas if meta.extra), None)
        if extra is None:
            continue
        if "parts" in extra:
            inner = {member.attribute: member for member in _members(kind, "json")}
            for name, part in extra["parts"][door].items():
                yield replace(inner[part], name=name, attribute=f"{attribute}.{part}")
        elif (name := extra["names"][door]) is not None:
            arrow = extra["arrow"] or _arrow(kind)
            yield Member(name or attribute, attribute, kind, extra["meaning"], extra["unit"], arrow)


def _arrow(kind: Any) -> str:
    """The type of a column for `kind`, or for `kind` and None; "" where it does not follow."""
    kinds = {kind, *get_args(kind)} & ARROW.keys()
    return ARROW[kinds.pop()] if kinds else ""


def _annotations(record: type[msgspec.Struct]) -> dict[str, Any]:
    """The annotations of `record`'s fields, and of what its properties return."""
    getters = {name: value.fget for name, value in vars(record).items() if isinstance(value, property)}
    returned = {name: get_type_hints(read, include_extras=True)["return"] for name, read in getters.items()}
    return {field.name: field.type for field in msgspec.structs.fields(record)} | returned
