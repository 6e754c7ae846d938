"""Moves a server from SQLite to an empty PostgreSQL, in one transaction of it: all rows or none.

Rows are written as Django writes them, read back, and compared by count and by digest.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import dj_database_url
import psycopg
from django.apps import apps
from django.core.management.color import no_style
from django.core.management.sql import emit_post_migrate_signal
from django.db import DEFAULT_DB_ALIAS, OperationalError, connection, connections, transaction
from django.db.migrations.executor import MigrationExecutor
from django.db.models import JSONField, Model

from crowd.database import upgrade

TARGET = "target"


class MoveError(Exception):
    """The database cannot be moved; the message gives the reason and the remedy. Nothing changed."""


@dataclass(frozen=True)
class Content:
    """What a table holds. Equal contents have equal digests on all databases."""

    rows: int
    sha256: str


def move(url: str) -> dict[str, Content]:
    """Copy all tables of this server to the empty PostgreSQL at `url`; returns their contents by name.

    Raises MoveError. Writers wait for the file of SQLite meanwhile.
    """
    if connection.vendor != "sqlite":
        raise MoveError(f"the database is {connection.vendor}, not SQLite: use backup and restore")
    if upgrade.is_behind(connection):
        raise MoveError("the database lacks migrations of this version: run manage.py migrate first")
    target = _connect(url)
    with transaction.atomic(), transaction.atomic(TARGET):
        executor = MigrationExecutor(target)
        executor.migrate(executor.loader.graph.leaf_nodes())
        with target.cursor() as cursor:
            cursor.execute("SET CONSTRAINTS ALL DEFERRED")  # rows come before those they point to
            for model in _models():
                _copy(model, cursor.cursor)
            for statement in target.ops.sequence_reset_sql(no_style(), _models()):
                cursor.execute(statement)
        upgrade.check_constraints(TARGET)
        emit_post_migrate_signal(verbosity=0, interactive=False, db=TARGET)  # makes the triggers
        here, there = contents(DEFAULT_DB_ALIAS), contents(TARGET)
        if different := [name for name in here if here[name] != there[name]]:
            raise MoveError(f"the copies differ in {', '.join(different)}: please report this")
    return here


def contents(using: str) -> dict[str, Content]:
    """The content of each table of Django's models, by the table's name."""
    return {model._meta.db_table: _content(model, using) for model in _models()}


def _connect(url: str) -> Any:
    if not url.startswith(("postgresql://", "postgres://")):
        raise MoveError(
            "--to names no PostgreSQL: give an address such as postgresql://USER:PASSWORD@HOST/NAME"
        )
    databases = {DEFAULT_DB_ALIAS: {}, TARGET: dj_database_url.parse(url)}
    connections.settings[TARGET] = connections.configure_settings(databases)[TARGET]
    target = connections[TARGET]
    try:
        filled = target.introspection.table_names()
    except OperationalError as error:
        raise MoveError(f"the database of --to does not answer ({' '.join(str(error).split())})") from error
    if filled:
        raise MoveError(f"the database of --to has {len(filled)} tables: name an empty one")
    return target


def _models() -> list[type[Model]]:
    every = apps.get_models(include_auto_created=True)
    return [model for model in every if model._meta.managed and not model._meta.proxy]


def _copy(model: type[Model], cursor: psycopg.Cursor[Any]) -> None:
    fields, target = model._meta.concrete_fields, connections[TARGET]
    columns = ", ".join(target.ops.quote_name(str(field.column)) for field in fields)
    table = target.ops.quote_name(model._meta.db_table)
    try:
        with cursor.copy(f"COPY {table} ({columns}) FROM STDIN") as copy:
            for row in _rows(model, DEFAULT_DB_ALIAS):
                copy.write_row(
                    [field.get_db_prep_save(value, target) for field, value in zip(fields, row, strict=True)]
                )
    except psycopg.DataError as error:
        raise MoveError(f"PostgreSQL cannot store a row of {model._meta.db_table}: {error}") from error


def _content(model: type[Model], using: str) -> Content:
    is_json = [isinstance(field, JSONField) for field in model._meta.concrete_fields]
    count = total = 0
    for row in _rows(model, using):
        shown = [_canonical(value) if json else value for value, json in zip(row, is_json, strict=True)]
        # A sum: databases sort texts differently.
        total += int.from_bytes(hashlib.sha256(repr(shown).encode()).digest())
        count += 1
    return Content(count, f"{total % (1 << 256):064x}")


def _canonical(value: Any) -> Any:
    """`value` of JSON with sorted members and whole numbers as integers: PostgreSQL keeps no texts."""
    if isinstance(value, dict):
        return [[name, _canonical(value[name])] for name in sorted(value)]
    if isinstance(value, list):
        return [_canonical(each) for each in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _rows(model: type[Model], using: str) -> Iterator[tuple[Any, ...]]:
    names = [field.attname for field in model._meta.concrete_fields]
    return model._base_manager.using(using).values_list(*names).iterator()
