"""Writing to the audit log."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from django.contrib.auth import get_user_model

from crowd.audit.models import AuditEntry

COMMAND_LINE = "command line"
_current: ContextVar[str] = ContextVar("actor", default=COMMAND_LINE)


@contextmanager
def acting(actor: str) -> Iterator[None]:
    """A block in which `actor` does what `record_by_current` logs. Without one, it is the command line."""
    before = _current.set(actor)
    try:
        yield
    finally:
        _current.reset(before)


def record_by_current(action: str, subject: str, note: str = "") -> AuditEntry:
    """As `record`, by the actor of the block."""
    return record(_current.get(), action, subject, note)


def account_id(name: str) -> int | None:
    """The id of the account called `name`; None for a program."""
    return get_user_model().objects.filter(username=name).values_list("pk", flat=True).first()


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
    """Log that `actor` (a user name, or COMMAND_LINE) did `action` to `subject`.

    Call it in the transaction of the action itself: both are stored, or neither. `action` has at most 64
    characters, `subject` 200; details belong in `note`. `front_id` protects that front from deletion. Entries
    are permanent: never log addresses or tokens. The id of `actor`'s account is kept, too.
    """
    return AuditEntry.objects.create(
        actor=actor,
        account=account_id(actor),
        action=action,
        subject=subject,
        note=note,
        from_state=from_state,
        to_state=to_state,
        digest=digest,
        front_id=front_id,
    )
