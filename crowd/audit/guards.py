"""Triggers of SQLite and PostgreSQL that keep entries of the audit log from being changed or deleted.

Migrations and `manage.py flush`, which empties the whole database, drop them.
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
OBSOLETE = ("front_audit_fixed",)  # from releases whose log held only fronts


def create(using: str = "default", **_: Any) -> None:
    """Create the triggers, if the table exists."""
    triggers.create(TRIGGERS, using)


def drop(using: str = "default", **_: Any) -> None:
    """Drop the triggers."""
    triggers.drop((*(trigger.name for trigger in TRIGGERS), *OBSOLETE), using)
