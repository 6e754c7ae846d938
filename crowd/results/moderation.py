"""What administrators decide of a session or run: hide it, or let it count. Each decision is logged."""

from django.core.exceptions import ValidationError
from django.db import transaction

from crowd.results.figures import sessions as session_figures
from crowd.results.models import Decision, MeasurementSession, Run


@transaction.atomic
def decide(
    action: str, by: str, reason: str, session: MeasurementSession, run: Run | None = None
) -> Decision:
    """Log the decision on SESSION, or on one RUN of it, and compute what rests on it again.

    A quarantine hides until a later release; a release lifts suspicion and quarantine by the rules, never
    what makes a run invalid. Raises ValidationError for an unknown action or without a reason.
    """
    if action not in Decision.Action.values:
        raise ValidationError(f"{action!r} is not an action: {' or '.join(Decision.Action.values)} is")
    if not reason.strip():
        raise ValidationError("a decision needs a reason for the log")
    decision = Decision.objects.create(
        actor=by, action=action, reason=reason.strip(), session=session, run=run
    )
    session_figures.summarise_sessions([session.pk])
    return decision
