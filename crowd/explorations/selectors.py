"""Reads of explorations: their progress, and pages of their evaluations."""

from dataclasses import dataclass
from typing import NamedTuple

from django.db.models import Count, OuterRef, QuerySet, Subquery
from django.db.models.functions import Coalesce

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.watching import ExplorationStatus
from crowd.explorations.searching.search import COPIED, FINISHED, SEARCHED
from crowd.fronts.models import FrontVersion
from wire.front import Front


@dataclass(frozen=True)
class Progress:
    """An exploration with the counts of its evaluations by state; `searched`: finished ones of the search."""

    exploration: Exploration
    pending: int
    running: int
    done: int
    failed: int
    searched: int


class Counted(NamedTuple):
    """Finished measurements, and all."""

    done: int
    all: int


@dataclass(frozen=True)
class PreparationProgress:
    """How far a preparation is. `left_out`: (name in the draft, reason), once it is complete."""

    key: int
    state: str
    device: str
    note: str
    references: Counted
    times: Counted
    rounds: int
    failed: int
    left_out: tuple[tuple[str, str], ...]

    @property
    def active(self) -> bool:
        """Whether it measures, or can be resumed."""
        return self.state in (Exploration.State.RUNNING, Exploration.State.PAUSED)

    @property
    def complete(self) -> bool:
        return self.state == Exploration.State.DONE


def preparation_progress(front: FrontVersion) -> PreparationProgress | None:
    """The progress of the newest preparation of `front`; None without one. Two queries."""
    preparation = front.preparations.select_related("reference_device").order_by("-pk").first()
    if preparation is None:
        return None
    rows = list(preparation.evaluations.values_list("phase", "state", "iteration"))

    def counted(phase: str) -> Counted:
        states = [state for its_phase, state, _ in rows if its_phase == phase]
        return Counted(sum(state in FINISHED for state in states), len(states))

    complete = preparation.state == Exploration.State.DONE
    left_out = front.content.provenance.get("prepared", {}).get("left_out", {}) if complete else {}
    return PreparationProgress(
        key=preparation.pk,
        state=preparation.state,
        device=preparation.reference_device.name,
        note=preparation.note,
        references=counted(Evaluation.Phase.REFERENCE),
        times=counted(Evaluation.Phase.TIME),
        rounds=len({iteration for phase, _, iteration in rows if phase == Evaluation.Phase.TIME}),
        failed=sum(state == Evaluation.State.FAILED for _, state, _ in rows),
        left_out=tuple(left_out.items()),
    )


def preparation_key(slug: str) -> int | None:
    """The exploration that prepared the front `slug` here; None if it was prepared elsewhere. One query."""
    done = Exploration.objects.filter(prepares__slug=slug, state=Exploration.State.DONE)
    return done.values_list("pk", flat=True).first()


def exploration_key(front: Front) -> int | None:
    """The exploration that `front` comes from; None if it is not here. One query, none if it is not named."""
    sha256 = front.provenance.get("exploration", {}).get("sha256")
    return sha256 and Exploration.objects.filter(sha256=sha256).values_list("pk", flat=True).first()


def with_counts() -> QuerySet[Exploration]:
    """Explorations annotated with pending, running, done, failed and searched, and their device."""
    not_copied = Evaluation.objects.exclude(phase__in=COPIED)
    numbers = {state.value: _number(not_copied.filter(state=state)) for state in Evaluation.State}
    searched = _number(not_copied.filter(phase__in=SEARCHED, state__in=FINISHED))
    return Exploration.objects.select_related("reference_device").annotate(**numbers, searched=searched)


def explorations() -> tuple[Progress, ...]:
    """All searches, newest first, without preparations of fronts. One query."""
    return tuple(
        Progress(row, *(getattr(row, name) for name in (*Evaluation.State.values, "searched")))
        for row in with_counts().filter(prepares=None)
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
    """The evaluations with the numbers `wanted`, in order."""
    return exploration.evaluations.filter(number__in=wanted).order_by("number")


def _number(rows: QuerySet[Evaluation]) -> Coalesce:
    """The count of `rows` by exploration, as a subquery: a join would copy each space into its rows."""
    mine = rows.filter(exploration=OuterRef("pk")).order_by().values("exploration")
    return Coalesce(Subquery(mine.annotate(rows=Count("pk")).values("rows")), 0)
