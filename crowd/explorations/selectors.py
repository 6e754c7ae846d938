"""Reads of explorations: how far each has come, and all that one measured."""

from dataclasses import dataclass

from django.db.models import Count, Q, QuerySet

from crowd.explorations import points
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.points import Point
from crowd.explorations.search import FINISHED, SEARCHED
from crowd.explorations.watching import COPIED


@dataclass(frozen=True)
class Progress:
    """An exploration with the numbers of its own evaluations by state; `searched`: finished ones it chose."""

    exploration: Exploration
    pending: int
    running: int
    done: int
    failed: int
    searched: int


@dataclass(frozen=True)
class Detail:
    """An exploration with every evaluation, in order, and the front of what is measured so far."""

    progress: Progress
    evaluations: tuple[Evaluation, ...]
    front: tuple[Point, ...]


def counted() -> QuerySet[Exploration]:
    """Explorations annotated with pending, running, done, failed and searched, and their device."""
    own = ~Q(evaluations__phase__in=COPIED)
    numbers = {
        state.value: Count("evaluations", filter=own & Q(evaluations__state=state))
        for state in Evaluation.State
    }
    searched = Q(evaluations__phase__in=SEARCHED, evaluations__state__in=FINISHED)
    return Exploration.objects.select_related("reference_device").annotate(
        **numbers, searched=Count("evaluations", filter=searched)
    )


def explorations() -> tuple[Progress, ...]:
    """Every exploration, newest first. One query."""
    return tuple(_progress(row) for row in counted())


def exploration(key: int) -> Detail | None:
    """The exploration with that key, None if there is none. Two queries."""
    row = counted().filter(pk=key).first()
    if row is None:
        return None
    evaluations = tuple(row.evaluations.all())
    return Detail(_progress(row), evaluations, tuple(points.front(row, points.measured(evaluations))))


def _progress(row: Exploration) -> Progress:
    return Progress(row, *(getattr(row, name) for name in (*Evaluation.State.values, "searched")))
