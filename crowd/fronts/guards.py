"""The database itself holds fixed what is out of draft, and the audit log: triggers on SQLite and PostgreSQL.

Models refuse such changes with a better message; triggers also stop what goes past them. They are taken off
before migrations, which may copy tables, and put on again afterwards. Whole fronts are held by the audit
log's foreign key. Deleting a configuration by hand is what no trigger stops; the digest then no longer fits.
"""

from typing import Any

from django.db import connections

from crowd.fronts.models import MUTABLE, PERMITTED, AuditEntry, Configuration, FrontVersion

FRONT, CONFIGURATION, AUDIT = (model._meta.db_table for model in (FrontVersion, Configuration, AuditEntry))
# Name of each trigger: its table, what sets it off, and when it refuses.
CONTENT, STEP, POINT_CHANGED, POINT_ADDED, LOGGED = (
    "front_content_fixed",
    "front_step_permitted",
    "front_point_fixed",
    "front_point_refused",
    "front_audit_fixed",
)


def put_on(using: str = "default", **_: Any) -> None:
    """Create the triggers, as the models have it now, where the tables are there."""
    connection = connections[using]
    if not _supported(connection):
        return
    take_off(using)
    with connection.cursor() as cursor:
        for name, (table, event, condition, message) in _rules(connection.vendor).items():
            for statement in _creation(connection.vendor, name, table, event, condition, message):
                cursor.execute(statement)


def take_off(using: str = "default", **_: Any) -> None:
    """Drop the triggers, so that a migration may do what it must."""
    connection = connections[using]
    if not _supported(connection):
        return
    with connection.cursor() as cursor:
        for name, (table, *_rest) in _rules(connection.vendor).items():
            on_table = f" ON {table}" if connection.vendor == "postgresql" else ""
            cursor.execute(f"DROP TRIGGER IF EXISTS {name}{on_table}")


def _supported(connection: Any) -> bool:
    tables = {FRONT, CONFIGURATION, AUDIT}
    return connection.vendor in {"sqlite", "postgresql"} and tables <= set(
        connection.introspection.table_names()
    )


def _rules(vendor: str) -> dict[str, tuple[str, str, str, str]]:
    draft = FrontVersion.State.DRAFT.value
    fixed = [field.attname for field in FrontVersion._meta.concrete_fields if field.name not in MUTABLE]
    permitted = " OR ".join(
        f"(OLD.state = '{before}' AND NEW.state = '{after}')"
        for before, afters in PERMITTED.items()
        for after in sorted(afters)
    )

    def out_of_draft(row: str) -> str:
        return f"EXISTS (SELECT 1 FROM {FRONT} WHERE id = {row}.front_id AND state <> '{draft}')"

    return {
        CONTENT: (
            FRONT,
            "UPDATE",
            f"OLD.state <> '{draft}' AND ({_differs(vendor, fixed)})",
            "a front that is no draft any more cannot change",
        ),
        STEP: (
            FRONT,
            "UPDATE",
            f"NEW.state <> OLD.state AND NOT ({permitted})",
            "a front may not go from that state to this",
        ),
        POINT_CHANGED: (
            CONFIGURATION,
            "UPDATE",
            f"{out_of_draft('OLD')} OR {out_of_draft('NEW')}",
            "a configuration of a front that is no draft any more cannot change",
        ),
        POINT_ADDED: (
            CONFIGURATION,
            "INSERT",
            out_of_draft("NEW"),
            "a front that is no draft any more takes no further configuration",
        ),
        LOGGED: (AUDIT, "UPDATE", "1 = 1", "the audit log is only ever added to"),
    }


def _differs(vendor: str, columns: list[str]) -> str:
    comparison = "IS DISTINCT FROM" if vendor == "postgresql" else "IS NOT"
    return " OR ".join(f"NEW.{column} {comparison} OLD.{column}" for column in columns)


def _creation(
    vendor: str, name: str, table: str, event: str, condition: str, message: str
) -> tuple[str, ...]:
    if vendor == "sqlite":
        return (
            f"CREATE TRIGGER {name} BEFORE {event} ON {table} WHEN {condition} "
            f"BEGIN SELECT RAISE(ABORT, '{message}'); END",
        )
    # A trigger's own condition may not ask another table on PostgreSQL, its function may.
    return (
        f"CREATE OR REPLACE FUNCTION {name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        f"IF {condition} THEN RAISE EXCEPTION '{message}' USING ERRCODE = 'integrity_constraint_violation'; "
        "END IF; RETURN NEW; END $$",
        f"CREATE TRIGGER {name} BEFORE {event} ON {table} FOR EACH ROW EXECUTE FUNCTION {name}()",
    )
