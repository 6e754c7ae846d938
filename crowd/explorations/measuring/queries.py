"""The SQL statements around each measurement.

Django takes up to ten times as long to build one of these statements as the database to execute it. For quick
measurements, that would dominate.
"""

import json
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import cache
from typing import Any

from django.db import connection, models

from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from wire.evaluation import Outcome

PENDING, RUNNING = Evaluation.State.PENDING.value, Evaluation.State.RUNNING.value
# The fields that a measurement reads. Others, such as the space, are read when they are needed.
FIELDS_READ: dict[type[models.Model], set[str]] = {
    Evaluation: {
        *("id", "exploration", "number", "phase", "label", "configuration", "frames", "perturbation"),
        "stop_above",
        *("state", "attempt", "lease_until"),
    },
    Exploration: {
        *("id", "reference_device", "application", "sequence", "sequence_sha256", "state", "synchronous"),
        *("batch", "objectives", "limits", "note", "further_sequences", "held_out_sequences"),
        "error_quantile",
    },
    ReferenceDevice: {"id", "name", "queue", "backend", "opencl_device", "machines"},
}
MODEL_FIELDS: dict[type[models.Model], list[Any]] = {  # in the order of `from_db`
    model: [field for field in model._meta.concrete_fields if field.name in names]
    for model, names in FIELDS_READ.items()
}
EVALUATIONS, EXPLORATIONS, DEVICES = (model._meta.db_table for model in MODEL_FIELDS)
COLUMNS = [
    f"{model._meta.db_table}.{field.column}" for model, fields in MODEL_FIELDS.items() for field in fields
]
READ_AND_LOCK = f"""
    SELECT {", ".join(COLUMNS)} FROM {EVALUATIONS}
    JOIN {EXPLORATIONS} ON {EXPLORATIONS}.id = {EVALUATIONS}.exploration_id
    JOIN {DEVICES} ON {DEVICES}.id = {EXPLORATIONS}.reference_device_id
    WHERE {EVALUATIONS}.id = %s
"""
COUNT_LIVE_LEASES = f"""
    SELECT count(*) FROM {EVALUATIONS} held
    JOIN {EXPLORATIONS} searching ON searching.id = held.exploration_id
    WHERE held.state = '{RUNNING}' AND held.lease_until >= %s AND searching.reference_device_id = %s
"""
# Subqueries: with a join, conditions on a row that changes during the wait for its lock would not be checked
# again.
LEASE = f"""
    UPDATE {EVALUATIONS} SET state = '{RUNNING}', attempt = attempt + 1, worker = %s, started_at = %s,
        heartbeat_at = %s, lease_until = %s, losses = losses + CASE state WHEN '{RUNNING}' THEN 1 ELSE 0 END
    WHERE id = %s AND attempt = %s AND (state = '{PENDING}' OR state = '{RUNNING}' AND lease_until < %s)
        AND exploration_id IN (SELECT id FROM {EXPLORATIONS} WHERE state = '{Exploration.State.RUNNING}')
        AND ({COUNT_LIVE_LEASES}) < %s
"""
FINISHED_FIELDS: list[Any] = [
    Evaluation._meta.get_field(name) for name in ("state", "reference", *Outcome.__struct_fields__)
]
FINISH = f"""
    UPDATE {EVALUATIONS} SET {", ".join(f"{field.column} = %s" for field in FINISHED_FIELDS)},
        lease_until = NULL, finished_at = %s
    WHERE id = %s AND attempt = %s AND state IN ('{PENDING}', '{RUNNING}')
"""
UNFINISHED = f"""
    SELECT 1 FROM {EVALUATIONS}
    WHERE exploration_id = %s AND state IN ('{PENDING}', '{RUNNING}') LIMIT %s
"""


def read_and_lock(evaluation: int) -> Evaluation | None:
    """The evaluation with that key, with MODEL_FIELDS of its exploration and device; None if unknown.

    Only the device is locked, until the end of the transaction.
    """
    lock = f"FOR UPDATE OF {DEVICES}" if connection.features.has_select_for_update_of else ""
    with connection.cursor() as cursor:
        cursor.execute(READ_AND_LOCK + lock, [evaluation])
        row = cursor.fetchone()
    if row is None:
        return None
    stored: Evaluation
    stored, exploration, device = _models(row)
    exploration.reference_device = device
    stored.exploration = exploration
    return stored


def count_live_leases(device: int, now: datetime) -> int:
    """The number of live leases on evaluations of the device with that key."""
    with connection.cursor() as cursor:
        cursor.execute(COUNT_LIVE_LEASES, [_adapt_datetime(now), device])
        return int(cursor.fetchone()[0])


def lease(evaluation: Evaluation, worker: str, now: datetime, until: datetime) -> bool:
    """Lease `evaluation`, if it is available, unchanged since it was read, and a machine is free."""
    device = evaluation.exploration.reference_device
    begun, end = _adapt_datetime(now), _adapt_datetime(until)
    held = [evaluation.pk, evaluation.attempt, begun, begun, device.pk, device.machines]
    return _execute(LEASE, [worker, begun, begun, end, *held])


def finish(evaluation: Evaluation, now: datetime, **values: Any) -> bool:
    """Store `values` of FINISHED_FIELDS of `evaluation`, unless another worker took it since.

    Those that are not given get their defaults.
    """
    row = [values[field.name] if field.name in values else field.get_default() for field in FINISHED_FIELDS]
    texts = [json.dumps(value) if isinstance(value, dict | list) else value for value in row]
    return _execute(FINISH, [*texts, _adapt_datetime(now), evaluation.pk, evaluation.attempt])


def unfinished(exploration: int, most: int) -> int:
    """The number of pending and running evaluations, counted up to `most`."""
    with connection.cursor() as cursor:
        cursor.execute(UNFINISHED, [exploration, most])
        return len(cursor.fetchall())


def _execute(statement: str, values: Sequence[Any]) -> bool:
    with connection.cursor() as cursor:
        cursor.execute(statement, values)
        return bool(cursor.rowcount)


def _adapt_datetime(moment: datetime) -> Any:
    return connection.ops.adapt_datetimefield_value(moment)


def _models(row: Sequence[Any]) -> list[Any]:
    """The instances of the models in MODEL_FIELDS from the columns of `row`."""
    values = iter(row)
    return [
        model.from_db("default", names, [convert(next(values)) for convert in conversions])
        for model, names, conversions in _conversions(connection.vendor)
    ]


@cache
def _conversions(vendor: str) -> list[tuple[Any, list[str], list[Callable[[Any], Any]]]]:  # noqa: ARG001
    """The attributes of each model in MODEL_FIELDS, with the converters of their values."""
    return [
        (model, [field.attname for field in fields], [_conversion(field) for field in fields])
        for model, fields in MODEL_FIELDS.items()
    ]


def _conversion(field: Any) -> Callable[[Any], Any]:
    column = field.get_col(field.model._meta.db_table)
    steps = [*connection.ops.get_db_converters(column), *column.get_db_converters(connection)]

    def convert(value: Any) -> Any:
        for step in steps:
            value = step(value, column, connection)
        return value

    return convert
