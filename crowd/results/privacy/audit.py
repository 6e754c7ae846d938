"""The log entry of what administrators do with measurements."""

from crowd.fronts.models import AuditEntry


def log(actor: str, action: str, subject: str, note: str) -> None:
    """Record that ACTOR (a user name) did ACTION to SUBJECT. The entry stays: name no participant in it."""
    AuditEntry.objects.create(actor=actor, action=action, slug=subject, digest="", note=note)
