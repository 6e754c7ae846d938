"""Queries and inserts whose SQL is compiled once.

Django takes longer to compile a statement than a database to execute it. Only the few statements of every
submission and of most pages need this; all other code uses querysets.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from django.db import DEFAULT_DB_ALIAS, connection, connections
from django.db.backends.utils import CursorWrapper
from django.db.models import AutoField, Expression, Field, Model, QuerySet
from django.db.models.sql.compiler import SQLCompiler


class Placeholder(Expression):
    """A parameter of a query, called `name`, whose value is given later and converted by `field`."""

    def __init__(self, name: str, field: "Field[Any, Any]") -> None:
        super().__init__(output_field=field)
        self.name = name

    def as_sql(self, compiler: SQLCompiler, connection: Any) -> tuple[str, Any]:  # noqa: ARG002
        return "%s", (self,)


class CompiledQuery:
    """A compiled queryset. `make` builds it with values_list() and with Placeholders in its conditions."""

    def __init__(self, make: Callable[[], "QuerySet[Any, tuple[Any, ...]]"]) -> None:
        self._make = make
        self._compiled: dict[str, tuple[str, tuple[Any, ...], list[tuple[int, Any, Any]]]] = {}

    def rows(self, **values: Any) -> list[tuple[Any, ...]]:
        """Execute the query with `values`, by the names of its placeholders."""
        sql, parameters, conversions = self._compiled.get(connection.vendor) or self._compile()
        with _cursor(connections[DEFAULT_DB_ALIAS]) as cursor:
            cursor.execute(sql, [_convert(each, values) for each in parameters])
            rows = [list(row) for row in cursor.fetchall()]
        for column, converter, expression in conversions:
            for row in rows:
                row[column] = converter(row[column], expression, connection)
        return [tuple(row) for row in rows]

    def _compile(self) -> tuple[str, tuple[Any, ...], list[tuple[int, Any, Any]]]:
        compiler = self._make().query.get_compiler(connection=connection)
        sql, parameters = compiler.as_sql()
        converters = compiler.get_converters([expression for expression, *_ in compiler.select])
        conversions = [
            (column, converter, expression)
            for column, (each, expression) in converters.items()
            for converter in each
        ]
        self._compiled[connection.vendor] = compiled = sql, tuple(parameters), conversions
        return compiled


def _convert(parameter: Any, values: dict[str, Any]) -> Any:
    if not isinstance(parameter, Placeholder):
        return parameter
    return parameter.output_field.get_db_prep_value(values[parameter.name], connection)


def insert(rows: Sequence[Model]) -> None:
    """Insert `rows` of one model with one executemany. Keys that the database assigns are not read back.

    Raises IntegrityError as bulk_create does.
    """
    if not rows:
        return
    # The connection itself: its proxy would look the thread's connection up for each field.
    database = connections[DEFAULT_DB_ALIAS]
    sql, fields = _insert_statement(type(rows[0]), database.vendor)
    with _cursor(database) as cursor:
        cursor.executemany(sql, [_values(row, fields, database) for row in rows])


def insert_for(rows: Sequence[Model], relation: str, unique: str) -> None:
    """As `insert`, for rows whose `relation` is a row that `insert` stored, so that its key is unknown.

    The database finds it by the `unique` field of that row.
    """
    if not rows:
        return
    database = connections[DEFAULT_DB_ALIAS]
    sql, fields = _insert_statement(type(rows[0]), database.vendor, relation, unique)
    with _cursor(database) as cursor:
        cursor.executemany(sql, [_values(row, fields, database, relation, unique) for row in rows])


def insert_keyed(rows: Sequence[Model]) -> None:
    """Insert `rows` one by one, and set the key that the database assigned to each."""
    database = connections[DEFAULT_DB_ALIAS]
    for row in rows:
        sql, fields = _insert_statement(type(row), database.vendor)
        key = database.ops.quote_name(str(row._meta.pk.column))
        with _cursor(database) as cursor:
            cursor.execute(f"{sql} RETURNING {key}", _values(row, fields, database))
            (row.pk,) = cursor.fetchone()


def _cursor(database: Any) -> CursorWrapper:
    """A cursor whose statements PostgreSQL prepares once per connection, from the fifth execution on.

    Django's own cursor writes the values into the SQL, so that no two statements are the same.
    """
    cursor: CursorWrapper = database.cursor()
    if database.vendor == "postgresql":
        cursor.cursor = database.Database.Cursor(database.connection)
    return cursor


@cache
def _insert_statement(
    model: type[Model],
    vendor: str,  # noqa: ARG001 - key of the cache
    relation: str = "",
    unique: str = "",
) -> tuple[str, list[Any]]:
    fields = [field for field in model._meta.concrete_fields if not isinstance(field, AutoField)]
    quoted = connection.ops.quote_name
    columns = ", ".join(quoted(str(field.column)) for field in fields)
    marks = ", ".join(_key_of(field, unique) if field.name == relation else "%s" for field in fields)
    return f"INSERT INTO {quoted(model._meta.db_table)} ({columns}) VALUES ({marks})", fields


def _key_of(relation: Any, unique: str) -> str:
    """A subquery for the key of the row that `relation` refers to."""
    meta, quoted = relation.related_model._meta, connection.ops.quote_name
    key, known = (quoted(column) for column in (meta.pk.column, meta.get_field(unique).column))
    return f"(SELECT {key} FROM {quoted(meta.db_table)} WHERE {known} = %s)"


def _values(
    row: Model, fields: Sequence[Any], database: Any, relation: str = "", unique: str = ""
) -> list[Any]:
    values = []
    for field in fields:
        source = row
        if field.name == relation:
            source = getattr(row, relation)
            field = source._meta.get_field(unique)
        values.append(field.get_db_prep_save(field.pre_save(source, add=True), database))
    return values
