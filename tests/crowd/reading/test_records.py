"""A record is declared once: the API, the open data and the tables of the database agree with it."""

from datetime import datetime
from functools import reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin
from uuid import UUID

import msgspec
import pytest
from django.db import models

from crowd.explorations.models import Evaluation
from crowd.fronts.models import Configuration
from crowd.records.configuration import PublishedConfiguration
from crowd.records.measured_device import DeviceRow
from crowd.records.record import Record, answer, columns_of, fill, members
from crowd.records.run import RunRow
from crowd.records.session import SessionFile, SessionSpeedup, Summary
from crowd.records.speedup import Speedup
from crowd.records.tombstone import Erased
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run, SessionSummary, Tombstone
from crowd.results.opendata.tables import TABLES
from wire.evaluation import EvaluationRow
from wire.meaning import means, shows

STORED = [
    (DeviceSpeedup, Speedup),
    (Run, RunRow),
    (MeasurementSession, SessionFile),
    (SessionSummary, SessionSpeedup),
    (SessionSummary, Summary),
    (Configuration, PublishedConfiguration),
    (Tombstone, Erased),
    (Evaluation, EvaluationRow),
]
TYPES = {
    models.UUIDField: UUID,
    models.CharField: str,
    models.FloatField: float,
    models.IntegerField: int,
    models.BooleanField: bool,
    models.DateTimeField: datetime,
    models.BinaryField: bytes,
}
# Logarithms in the database, ratios in the record.
CONVERTED = {(SessionSpeedup, "low"), (SessionSpeedup, "high"), (Summary, "low"), (Summary, "high")}


class Maker(Record, frozen=True, kw_only=True):
    name: Annotated[str, means("maker of the part")]


class Part(Record, frozen=True, kw_only=True):
    maker: Annotated[Maker, shows(json={"maker": "name"}, column={})]
    key: Annotated[int, means("number of the part", json="id", column="part", arrow="int32")]
    weight: Annotated[float | None, means("how heavy it is", "g")]
    price: Annotated[float, means("what it costs", json=None)]
    note: str = ""

    @property
    def heavy(self) -> Annotated[bool, means("whether one person can lift it", column=None)]:
        return (self.weight or 0) > 30_000


class PartAnswer(answer(Part)):  # type: ignore[misc]
    sold: int


PART = Part(maker=Maker(name="Acme"), key=7, weight=None, price=2.5, note="inside")


def test_a_record_as_json_has_what_it_shows_under_the_names_that_it_says() -> None:
    shown = fill(PartAnswer, PART, sold=3)

    assert msgspec.to_builtins(shown) == {"maker": "Acme", "id": 7, "weight": None, "heavy": False, "sold": 3}


def test_a_schema_has_the_meanings_and_units_of_the_record() -> None:
    schema = msgspec.json.schema(PartAnswer)["$defs"]["PartAnswer"]["properties"]

    assert schema["weight"]["description"] == "how heavy it is, g"
    assert schema["maker"]["description"] == "maker of the part"
    assert "description" not in schema["sold"]


def test_columns_have_names_types_and_units() -> None:
    shown = [(column.name, column.arrow, column.unit) for column in members(Part, "column")]

    assert shown == [("part", "int32", ""), ("weight", "float64", "g"), ("price", "float64", "")]


def test_members_that_belong_to_another_answer_are_left_out() -> None:
    assert answer(Part, without=("maker", "heavy")).__struct_fields__ == ("id", "weight")


def plain(kind: Any) -> Any:
    """`kind` without meanings and bounds."""
    kind = getattr(kind, "__origin__", kind) if hasattr(kind, "__metadata__") else kind
    return reduce(or_, map(plain, get_args(kind))) if get_origin(kind) in (Union, UnionType) else kind


@pytest.mark.parametrize(("model", "record"), STORED)
def test_a_record_has_the_types_of_its_columns_in_the_database(
    model: type[models.Model], record: type[Record]
) -> None:
    kinds = {field.name: field.type for field in msgspec.structs.fields(record)}
    copied = columns_of(model, record)

    assert copied
    for name in copied:
        field = model._meta.get_field(name)
        [expected] = {kind for base, kind in TYPES.items() if isinstance(field, base)} or {None}
        if expected is None or (record, name) in CONVERTED:
            continue
        kind = plain(kinds[name])
        assert kind in (expected, expected | None), name
        assert (type(None) in getattr(kind, "__args__", ())) == field.null, name


def test_every_column_of_the_open_data_has_a_meaning_and_a_type() -> None:
    columns = [column for table in TABLES for column in table.columns]

    assert [column.name for column in columns if not (column.meaning and column.arrow)] == []
    assert DeviceRow in {record for table in TABLES for record in table.records}
