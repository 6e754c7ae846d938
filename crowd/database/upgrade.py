"""Brings the database to the tables of this program."""

from typing import Any

from django.core.management import CommandError, call_command
from django.db import connection, connections
from django.db.migrations.executor import MigrationExecutor
from django.db.migrations.recorder import MigrationRecorder

# A migration that every database had before 1.0, and none has since.
BEFORE_1_0 = ("results", "0001_initial")
REFUSAL = "was made before 1.0: this version cannot read it; the version that made it can"


def migrate() -> None:
    """Apply migrations that are missing. Raises CommandError if the database was made before 1.0."""
    executor = MigrationExecutor(connection)
    if executor.migration_plan(executor.loader.graph.leaf_nodes()):
        call_command("migrate", verbosity=0, interactive=False)


def refuse_before_1_0(using: str, **_: Any) -> None:
    """Receiver of pre_migrate: raises CommandError, before any change, if the database is older than 1.0."""
    database = connections[using]
    if BEFORE_1_0 in MigrationRecorder(database).applied_migrations():
        raise CommandError(f"the database {database.settings_dict['NAME']} {REFUSAL}")
