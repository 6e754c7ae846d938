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

    Call it in the transaction of the action itself: both are stored, or neither. ACTION has at most 64
    characters, SUBJECT 200; details belong in NOTE. FRONT_ID protects that front from deletion. Entries are
    permanent: never log addresses or tokens.
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
