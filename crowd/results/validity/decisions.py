"""Which decision of an administrator holds for a session or a run."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

from crowd.results.models import Decision


class RunOfSession(Protocol):
    """A run: a model instance, or the columns of one."""

    pk: int
    session_id: int


@dataclass(frozen=True)
class Decisions:
    """The newest decision on each session as a whole, and on each single run, by key."""

    sessions: dict[int, Decision]
    runs: dict[int, Decision]

    @classmethod
    def on(cls, sessions: Collection[int]) -> "Decisions":
        """The decisions on the sessions with the keys SESSIONS, and on their runs. One query."""
        whole: dict[int, Decision] = {}
        single: dict[int, Decision] = {}
        for decision in Decision.objects.filter(session__in=sessions).order_by("pk"):
            if decision.run_id is None:
                whole[decision.session_id] = decision
            else:
                single[decision.run_id] = decision
        return cls(whole, single)

    def released(self, session: int) -> bool:
        """Whether an administrator lets SESSION (a key) count, against the rules on sessions and models."""
        decision = self.sessions.get(session)
        return decision is not None and decision.action == Decision.Action.RELEASE

    def on_run(self, run: RunOfSession) -> str | None:
        """The action that holds for RUN: the newest on itself or on its session; None where there is none."""
        both = [self.sessions.get(run.session_id), self.runs.get(run.pk)]
        newest = max((decision for decision in both if decision), key=lambda each: each.pk, default=None)
        return None if newest is None else newest.action
