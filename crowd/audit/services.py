"""Writing to the audit log."""

from typing import TYPE_CHECKING

from crowd.audit.models import AuditEntry

if TYPE_CHECKING:
    from crowd.fronts.models import FrontVersion

COMMAND_LINE = "command line"


def record(
    actor: str,
    action: str,
    subject: str,
    note: str = "",
    *,
    from_state: str = "",
    to_state: str = "",
    digest: str = "",
    front: "FrontVersion | None" = None,
) -> AuditEntry:
    """Log that ACTOR (a user name, or COMMAND_LINE) did ACTION to SUBJECT.

    Call it in the transaction of the action itself: both are stored, or neither. ACTION has 64 characters at
    most, SUBJECT 200; details belong into NOTE. Entries stay for good: no addresses, no tokens.
    """
    return AuditEntry.objects.create(
        actor=actor,
        action=action,
        subject=subject,
        note=note,
        from_state=from_state,
        to_state=to_state,
        digest=digest,
        front=front,
    )
