"""Which decision of an administrator applies to a session or a run."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

from crowd.results.models import Decision


class RunOfSession(Protocol):
    """A run: a model instance, or its columns."""

    pk: int
    session_id: int


@dataclass(frozen=True)
class Decisions:
    """The newest decision on each session, and on each run, by their keys."""

    sessions: dict[int, Decision]
    runs: dict[int, Decision]

    @classmethod
    def on(cls, sessions: Collection[int]) -> "Decisions":
        """Read the decisions on `sessions` (keys) and on their runs. One query."""
        whole: dict[int, Decision] = {}
        single: dict[int, Decision] = {}
        for decision in Decision.objects.filter(session__in=sessions).order_by("pk"):
            if decision.run_id is None:
                whole[decision.session_id] = decision
            else:
                single[decision.run_id] = decision
        return cls(whole, single)

    def released(self, session: int) -> bool:
        """Whether an administrator released `session` (a key): rules on sessions and models do not apply."""
        decision = self.sessions.get(session)
        return decision is not None and decision.action == Decision.Action.RELEASE

    def on_run(self, run: RunOfSession) -> str | None:
        """The newest action on `run` or on its session; None without one."""
        both = [self.sessions.get(run.session_id), self.runs.get(run.pk)]
        newest = max((decision for decision in both if decision), key=lambda each: each.pk, default=None)
        return None if newest is None else newest.action
