"""Triggers of SQLite and PostgreSQL that keep fronts unchanged once they are in review.

Models refuse such changes with a better message; triggers also stop SQL that bypasses them. They are dropped
before migrations, which may copy tables, and created again afterwards. A foreign key of the audit log
protects whole fronts. No trigger stops the deletion of a configuration, but then the digest no longer
matches.
"""

from typing import Any

from django.db import connections

from crowd.database import triggers
from crowd.database.triggers import Trigger
from crowd.fronts.models import MUTABLE, PERMITTED, Configuration, FrontVersion, Trajectory

FRONT, CONFIGURATION, TRAJECTORY = (
    model._meta.db_table for model in (FrontVersion, Configuration, Trajectory)
)
DRAFT = FrontVersion.State.DRAFT.value


def create(using: str = "default", **_: Any) -> None:
    """Create the triggers for the tables that exist."""
    triggers.create(_triggers(connections[using].vendor), using)


def drop(using: str = "default", **_: Any) -> None:
    """Drop the triggers before a migration."""
    triggers.drop([trigger.name for trigger in _triggers(connections[using].vendor)], using)


def _triggers(vendor: str) -> tuple[Trigger, ...]:
    fixed = [field.attname for field in FrontVersion._meta.concrete_fields if field.name not in MUTABLE]
    permitted = " OR ".join(
        f"(OLD.state = '{before}' AND NEW.state = '{after}')"
        for before, afters in PERMITTED.items()
        for after in sorted(afters)
    )
    return (
        Trigger(
            "front_content_fixed",
            FRONT,
            "UPDATE",
            "the content of a front cannot change after its draft",
            f"OLD.state <> '{DRAFT}' AND ({_differs(vendor, fixed)})",
        ),
        Trigger(
            "front_step_permitted",
            FRONT,
            "UPDATE",
            "a front cannot go from that state to this one",
            f"NEW.state <> OLD.state AND NOT ({permitted})",
        ),
        Trigger(
            "front_point_fixed",
            CONFIGURATION,
            "UPDATE",
            "a configuration cannot change after the draft of its front",
            f"{_after_draft('OLD')} OR {_after_draft('NEW')}",
        ),
        Trigger(
            "front_point_refused",
            CONFIGURATION,
            "INSERT",
            "a front cannot get configurations after its draft",
            _after_draft("NEW"),
        ),
        Trigger(
            "front_trajectory_fixed",
            TRAJECTORY,
            "UPDATE",
            "a trajectory cannot change: its digest is its name",
        ),
    )


def _after_draft(row: str) -> str:
    return f"EXISTS (SELECT 1 FROM {FRONT} WHERE id = {row}.front_id AND state <> '{DRAFT}')"


def _differs(vendor: str, columns: list[str]) -> str:
    comparison = "IS DISTINCT FROM" if vendor == "postgresql" else "IS NOT"
    return " OR ".join(f"NEW.{column} {comparison} OLD.{column}" for column in columns)
