"""The columns of evaluations that a search and its points read, without the cost of models."""

from collections.abc import Iterator
from datetime import datetime
from typing import Any, NamedTuple

from django.db.models import QuerySet

from crowd.explorations.models import Evaluation


class Row(NamedTuple):
    """An evaluation; its fields are those of the model."""

    pk: int
    number: int
    phase: str
    label: str
    state: str
    iteration: int
    configuration: dict[str, Any]
    configuration_key: str
    space_index: int | None  # the number in the space: tuples have an `index` of their own
    frames: int | None
    objectives: dict[str, float] | None
    parts: list[dict[str, Any]] | None
    censored: list[str]
    ratio_filled_at: datetime | None
    created_at: datetime
    finished_at: datetime | None


_COLUMNS = tuple("index" if name == "space_index" else name for name in Row._fields)


def read(evaluations: QuerySet[Evaluation]) -> Iterator[Row]:
    """`evaluations` in their order. One query."""
    return map(Row._make, evaluations.values_list(*_COLUMNS))
