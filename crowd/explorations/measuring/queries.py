"""What is asked of the database around every measurement, written out.

To build one of these statements takes Django up to ten times as long as the database to answer it, and of a
measurement that takes no time nothing else would be left.
"""

import json
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import cache
from typing import Any

from django.db import connection, models

from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice

PENDING, RUNNING = Evaluation.State.PENDING.value, Evaluation.State.RUNNING.value
# What a measurement reads: the rest, such as the space, is fetched where it is needed.
WANTED: dict[type[models.Model], set[str]] = {
    Evaluation: {
        *("id", "exploration", "number", "phase", "label", "configuration", "frames", "perturbation"),
        *("state", "attempt", "lease_until"),
    },
    Exploration: {
        *("id", "reference_device", "application", "sequence", "sequence_sha256", "state", "synchronous"),
        *("batch", "objectives", "limits", "note", "further_sequences", "held_out_sequences"),
        "error_quantile",
    },
    ReferenceDevice: {"id", "name", "queue", "backend", "opencl_device", "machines"},
}
READ: dict[type[models.Model], list[Any]] = {  # in the order that `from_db` wants
    model: [field for field in model._meta.concrete_fields if field.name in names]
    for model, names in WANTED.items()
}
EVALUATIONS, EXPLORATIONS, DEVICES = (model._meta.db_table for model in READ)
COLUMNS = [f"{model._meta.db_table}.{field.column}" for model, fields in READ.items() for field in fields]
TO_BE_TAKEN = f"""
    SELECT {", ".join(COLUMNS)} FROM {EVALUATIONS}
    JOIN {EXPLORATIONS} ON {EXPLORATIONS}.id = {EVALUATIONS}.exploration_id
    JOIN {DEVICES} ON {DEVICES}.id = {EXPLORATIONS}.reference_device_id
    WHERE {EVALUATIONS}.id = %s
"""
HELD = f"""
    SELECT count(*) FROM {EVALUATIONS} held
    JOIN {EXPLORATIONS} searching ON searching.id = held.exploration_id
    WHERE held.state = '{RUNNING}' AND held.lease_until >= %s AND searching.reference_device_id = %s
"""
# Subqueries, since a join would take the other conditions into one, where a row that changes while it is
# waited for is not looked at again.
LEASE = f"""
    UPDATE {EVALUATIONS} SET state = '{RUNNING}', attempt = attempt + 1, worker = %s, started_at = %s,
        heartbeat_at = %s, lease_until = %s, losses = losses + CASE state WHEN '{RUNNING}' THEN 1 ELSE 0 END
    WHERE id = %s AND attempt = %s AND (state = '{PENDING}' OR state = '{RUNNING}' AND lease_until < %s)
        AND exploration_id IN (SELECT id FROM {EXPLORATIONS} WHERE state = '{Exploration.State.RUNNING}')
        AND ({HELD}) < %s
"""
FINISH = f"""
    UPDATE {EVALUATIONS} SET state = %s, objectives = %s, stages = %s, device = %s, parts = %s, censored = %s,
        software = %s, error = %s, lease_until = NULL, finished_at = %s
    WHERE id = %s AND attempt = %s AND state IN ('{PENDING}', '{RUNNING}')
"""
UNFINISHED = f"""
    SELECT 1 FROM {EVALUATIONS}
    WHERE exploration_id = %s AND state IN ('{PENDING}', '{RUNNING}') LIMIT %s
"""


def to_be_taken(evaluation: int) -> Evaluation | None:
    """The evaluation with that key and what READ names of its exploration and device, None if there is none.

    The device alone is locked to the end of the transaction.
    """
    lock = f"FOR UPDATE OF {DEVICES}" if connection.features.has_select_for_update_of else ""
    with connection.cursor() as cursor:
        cursor.execute(TO_BE_TAKEN + lock, [evaluation])
        row = cursor.fetchone()
    if row is None:
        return None
    found, exploration, device = _models(row)
    exploration.reference_device = device
    found.exploration = exploration
    return found


def held(device: int, now: datetime) -> int:
    """How many leases on evaluations of the device with that key are alive."""
    with connection.cursor() as cursor:
        cursor.execute(HELD, [_stored(now), device])
        return int(cursor.fetchone()[0])


def lease(evaluation: Evaluation, worker: str, now: datetime, until: datetime) -> bool:
    """Hold EVALUATION, if nobody else does, none took it since it was read, and a machine is free."""
    device = evaluation.exploration.reference_device
    begun, end = _stored(now), _stored(until)
    held = [evaluation.pk, evaluation.attempt, begun, begun, device.pk, device.machines]
    return _changed(LEASE, [worker, begun, begun, end, *held])


def finish(evaluation: Evaluation, now: datetime, **values: Any) -> bool:
    """Store what became of EVALUATION, if nobody took it since: `state`, and the values given besides."""
    given = (values.get(name) for name in ("objectives", "stages", "device", "parts"))
    texts = [None if value is None else json.dumps(value) for value in given]
    censored = values.get("censored", False)
    row = [values["state"], *texts, censored, values["software"], values.get("error", ""), _stored(now)]
    return _changed(FINISH, [*row, evaluation.pk, evaluation.attempt])


def unfinished(exploration: int, most: int) -> int:
    """How many evaluations wait or are measured, counted up to MOST."""
    with connection.cursor() as cursor:
        cursor.execute(UNFINISHED, [exploration, most])
        return len(cursor.fetchall())


def _changed(statement: str, values: Sequence[Any]) -> bool:
    with connection.cursor() as cursor:
        cursor.execute(statement, values)
        return bool(cursor.rowcount)


def _stored(moment: datetime) -> Any:
    return connection.ops.adapt_datetimefield_value(moment)


def _models(row: Sequence[Any]) -> list[Any]:
    """The objects of the models in READ that ROW holds side by side."""
    values = iter(row)
    return [
        model.from_db("default", names, [convert(next(values)) for convert in conversions])
        for model, names, conversions in _conversions(connection.vendor)
    ]


@cache
def _conversions(vendor: str) -> list[tuple[Any, list[str], list[Callable[[Any], Any]]]]:  # noqa: ARG001
    """Of each model in READ the attributes, and what makes a value of each of what the database gives."""
    return [
        (model, [field.attname for field in fields], [_conversion(field) for field in fields])
        for model, fields in READ.items()
    ]


def _conversion(field: Any) -> Callable[[Any], Any]:
    column = field.get_col(field.model._meta.db_table)
    steps = [*connection.ops.get_db_converters(column), *column.get_db_converters(connection)]

    def convert(value: Any) -> Any:
        for step in steps:
            value = step(value, column, connection)
        return value

    return convert
