"""Decisions of administrators: exclude a session or run, or let it count. Each decision is logged."""

from django.core.exceptions import ValidationError
from django.db import transaction

from crowd.results.figures import sessions as session_figures
from crowd.results.models import Decision, MeasurementSession, Run


@transaction.atomic
def decide(
    action: str, by: str, reason: str, session: MeasurementSession, run: Run | None = None
) -> Decision:
    """Log a decision on `session`, or on one `run` of it, and summarise the session again.

    A quarantine excludes until a later release. A release lifts the states suspect and quarantined that the
    rules set, but never invalid. Raises ValidationError for an unknown action or without a reason.
    """
    if action not in Decision.Action.values:
        raise ValidationError(f"{action!r} is not an action: give {' or '.join(Decision.Action.values)}")
    if not reason.strip():
        raise ValidationError("reason is empty: a decision needs one for the log")
    decision = Decision.objects.create(
        actor=by, action=action, reason=reason.strip(), session=session, run=run
    )
    session_figures.summarise_sessions([session.pk])
    return decision
