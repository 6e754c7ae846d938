"""Reads of explorations: their progress, and pages of their evaluations."""

from dataclasses import dataclass

from django.db.models import Count, OuterRef, QuerySet, Subquery
from django.db.models.functions import Coalesce

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.watching import ExplorationStatus
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED


@dataclass(frozen=True)
class Progress:
    """An exploration with the counts of its evaluations by state; `searched`: finished ones of the search."""

    exploration: Exploration
    pending: int
    running: int
    done: int
    failed: int
    searched: int


def with_counts() -> QuerySet[Exploration]:
    """Explorations annotated with pending, running, done, failed and searched, and their device."""
    own = Evaluation.objects.exclude(phase__in=COPIED)
    numbers = {state.value: _number(own.filter(state=state)) for state in Evaluation.State}
    searched = _number(own.filter(phase__in=SEARCHED, state__in=FINISHED))
    return Exploration.objects.select_related("reference_device").annotate(**numbers, searched=searched)


def explorations() -> tuple[Progress, ...]:
    """All explorations, newest first. One query."""
    return tuple(
        Progress(row, *(getattr(row, name) for name in (*Evaluation.State.values, "searched")))
        for row in with_counts()
    )


def progress_from_status(seen: ExplorationStatus) -> Progress:
    """The progress of an exploration from its status."""
    return Progress(
        exploration=seen.exploration,
        pending=seen.waiting,
        running=len(seen.running),
        done=seen.finished - seen.failed,
        failed=seen.failed,
        searched=seen.searched,
    )


def numbers(exploration: Exploration) -> list[int]:
    """The numbers of its evaluations in order, without those from another device."""
    rows = exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number")
    return list(rows.values_list("number", flat=True))


def evaluations(exploration: Exploration, wanted: list[int]) -> QuerySet[Evaluation]:
    """The evaluations with the numbers WANTED, in order."""
    return exploration.evaluations.filter(number__in=wanted).order_by("number")


def _number(rows: QuerySet[Evaluation]) -> Coalesce:
    """The count of ROWS by exploration, as a subquery: a join would copy each space into its rows."""
    mine = rows.filter(exploration=OuterRef("pk")).order_by().values("exploration")
    return Coalesce(Subquery(mine.annotate(rows=Count("pk")).values("rows")), 0)
