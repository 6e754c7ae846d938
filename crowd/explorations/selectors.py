"""Reads of explorations: how far each has come, and what one measured, in pages."""

from dataclasses import dataclass

from django.db.models import Count, OuterRef, QuerySet, Subquery
from django.db.models.functions import Coalesce

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.watching import Watch
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED


@dataclass(frozen=True)
class Progress:
    """An exploration with the numbers of its own evaluations by state; `searched`: finished ones it chose."""

    exploration: Exploration
    pending: int
    running: int
    done: int
    failed: int
    searched: int


def counted() -> QuerySet[Exploration]:
    """Explorations annotated with pending, running, done, failed and searched, and their device."""
    own = Evaluation.objects.exclude(phase__in=COPIED)
    numbers = {state.value: _number(own.filter(state=state)) for state in Evaluation.State}
    searched = _number(own.filter(phase__in=SEARCHED, state__in=FINISHED))
    return Exploration.objects.select_related("reference_device").annotate(**numbers, searched=searched)


def explorations() -> tuple[Progress, ...]:
    """Every exploration, newest first. One query."""
    return tuple(
        Progress(row, *(getattr(row, name) for name in (*Evaluation.State.values, "searched")))
        for row in counted()
    )


def progress_of(seen: Watch) -> Progress:
    """The same of one exploration that is watched already."""
    return Progress(
        exploration=seen.exploration,
        pending=seen.waiting,
        running=len(seen.running),
        done=seen.finished - seen.failed,
        failed=seen.failed,
        searched=seen.searched,
    )


def numbers(exploration: Exploration) -> list[int]:
    """The numbers of all that it measures or knows, in order; what another device measured is none of it."""
    rows = exploration.evaluations.exclude(phase=Evaluation.Phase.PRIOR).order_by("number")
    return list(rows.values_list("number", flat=True))


def evaluations(exploration: Exploration, wanted: list[int]) -> QuerySet[Evaluation]:
    """The evaluations with the WANTED numbers, a part of `numbers`, in order."""
    return exploration.evaluations.filter(number__in=wanted).order_by("number")


def _number(rows: QuerySet[Evaluation]) -> Coalesce:
    """How many of ROWS an exploration has: counted one by one, as a join would carry each space along."""
    mine = rows.filter(exploration=OuterRef("pk")).order_by().values("exploration")
    return Coalesce(Subquery(mine.annotate(rows=Count("pk")).values("rows")), 0)
