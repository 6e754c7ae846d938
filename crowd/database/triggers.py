"""Triggers of SQLite and PostgreSQL that refuse statements, including raw SQL."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from django.db import connections

SUPPORTED = frozenset({"sqlite", "postgresql"})
ALWAYS = "1 = 1"


@dataclass(frozen=True)
class Trigger:
    """Refuses `event` (INSERT, UPDATE, DELETE or TRUNCATE) on rows of `table` that meet `condition`, with
    `message`.

    SQLite has no TRUNCATE: such a trigger is skipped there.
    """

    name: str
    table: str
    event: str
    message: str
    condition: str = ALWAYS


def create(triggers: Iterable[Trigger], using: str) -> None:
    """Create or replace `triggers`, if all their tables exist."""
    wanted, connection = list(triggers), connections[using]
    tables = {trigger.table for trigger in wanted}
    if connection.vendor not in SUPPORTED or not tables <= set(connection.introspection.table_names()):
        return
    drop([trigger.name for trigger in wanted], using)
    with connection.cursor() as cursor:
        for trigger in wanted:
            for statement in _creation(trigger, connection.vendor):
                cursor.execute(statement)


def drop(names: Iterable[str], using: str) -> None:
    """Drop the triggers called `names`, on any table."""
    connection = connections[using]
    if connection.vendor not in SUPPORTED:
        return
    with connection.cursor() as cursor:
        for name, on_table in _existing(cursor, connection.vendor, list(names)):
            cursor.execute(f"DROP TRIGGER IF EXISTS {name}{on_table}")


def _existing(cursor: Any, vendor: str, names: list[str]) -> list[tuple[str, str]]:
    """Each name with the ON clause of DROP TRIGGER, which PostgreSQL needs."""
    if vendor == "sqlite":
        return [(name, "") for name in names]
    cursor.execute(
        "SELECT tgname, ' ON ' || tgrelid::regclass FROM pg_trigger "
        "WHERE NOT tgisinternal AND tgname = ANY(%s)",
        [names],
    )
    return list(cursor.fetchall())


def _creation(trigger: Trigger, vendor: str) -> tuple[str, ...]:
    if vendor == "sqlite":
        if trigger.event == "TRUNCATE":
            return ()
        return (
            f"CREATE TRIGGER {trigger.name} BEFORE {trigger.event} ON {trigger.table} "
            f"WHEN {trigger.condition} BEGIN SELECT RAISE(ABORT, '{trigger.message}'); END",
        )
    each = "STATEMENT" if trigger.event == "TRUNCATE" else "ROW"
    # On PostgreSQL, the condition of a trigger cannot query another table, but its function can.
    return (
        f"CREATE OR REPLACE FUNCTION {trigger.name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        f"IF {trigger.condition} THEN RAISE EXCEPTION '{trigger.message}' "
        "USING ERRCODE = 'integrity_constraint_violation'; END IF; "
        "IF TG_OP = 'DELETE' THEN RETURN OLD; END IF; RETURN NEW; END $$",
        f"CREATE TRIGGER {trigger.name} BEFORE {trigger.event} ON {trigger.table} "
        f"FOR EACH {each} EXECUTE FUNCTION {trigger.name}()",
    )
