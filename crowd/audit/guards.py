"""Triggers of SQLite and PostgreSQL that keep entries of the audit log from being changed or deleted.

Migrations and `manage.py flush`, which empties the whole database, take them off.
"""

from typing import Any

from crowd.audit.models import AuditEntry
from crowd.database import triggers
from crowd.database.triggers import Trigger

TABLE = AuditEntry._meta.db_table
MESSAGE = "entries of the audit log cannot be changed or deleted"
TRIGGERS = (
    Trigger("audit_entry_changed", TABLE, "UPDATE", MESSAGE),
    Trigger("audit_entry_deleted", TABLE, "DELETE", MESSAGE),
    Trigger("audit_emptied", TABLE, "TRUNCATE", MESSAGE),
)
FORMER = ("front_audit_fixed",)  # of the releases in which the log held fronts alone


def put_on(using: str = "default", **_: Any) -> None:
    """Create the triggers, where the table is there."""
    triggers.put_on(TRIGGERS, using)


def take_off(using: str = "default", **_: Any) -> None:
    """Drop the triggers."""
    triggers.take_off((*(trigger.name for trigger in TRIGGERS), *FORMER), using)
