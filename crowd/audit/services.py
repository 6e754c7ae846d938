"""Writing to the audit log."""

from crowd.audit.models import AuditEntry

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
    front_id: int | None = None,
) -> AuditEntry:
    """Log that ACTOR (a user name, or COMMAND_LINE) did ACTION to SUBJECT.

    Call it in the transaction of the action itself: both are stored, or neither. ACTION has 64 characters at
    most, SUBJECT 200; details belong into NOTE. FRONT_ID keeps that front's row from being deleted. Entries
    stay for good: no addresses, no tokens.
    """
    return AuditEntry.objects.create(
        actor=actor,
        action=action,
        subject=subject,
        note=note,
        from_state=from_state,
        to_state=to_state,
        digest=digest,
        front_id=front_id,
    )
