"""Shapes of the answers about explorations."""

from collections.abc import Iterable
from datetime import datetime
from typing import Any

import msgspec

from crowd.disclosure import public
from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.points import Point
from crowd.explorations.selectors import Progress


class ExplorationSummary(msgspec.Struct):
    """One line in the list of explorations; evaluations are counted by state."""

    id: int
    application: str
    sequence: str
    reference_device: str
    method: str
    seed: int
    budget: int
    state: str
    evaluations: dict[str, int]
    created_at: datetime
    finished_at: datetime | None


class ExplorationPage(msgspec.Struct):
    """Explorations, newest first."""

    results: list[ExplorationSummary]
    next: str | None


class EvaluationAnswer(msgspec.Struct):
    """One measurement. Objectives: runtime in seconds a frame, ate_* in metres; null unless it is done."""

    number: int
    phase: str
    label: str
    state: str
    configuration: dict[str, Any]
    objectives: dict[str, float] | None
    stages: dict[str, float] | None
    error: str
    device: dict[str, Any] | None
    software: str
    finished_at: datetime | None


class FrontPoint(msgspec.Struct):
    """A point of the front: medians over its measurements.

    `frames` tells how many each of them ran, null for the whole sequence; it is the same for all of a front.
    """

    configuration: dict[str, Any]
    label: str
    phase: str
    objectives: dict[str, float]
    measurements: int
    frames: int | None


class ExplorationDetail(ExplorationSummary):
    """An exploration in full; `measurements` by pages, `next` is the address of the following one or null.

    Its front is that of what was measured over the whole sequence, as long as nothing was that of the search.
    `note` tells why it was paused by itself, or why a machine cannot measure.
    """

    space: dict[str, Any]
    sequence_sha256: str
    objectives: list[str]
    limits: dict[str, float]
    frames: int | None
    command: str
    note: str
    front: list[FrontPoint]
    measurements: list[EvaluationAnswer]
    next: str | None


def summary(progress: Progress) -> ExplorationSummary:
    """PROGRESS in a list."""
    return ExplorationSummary(**_summary(progress))


def detail(
    progress: Progress, front: Iterable[Point], measurements: Iterable[Evaluation], following: str | None
) -> ExplorationDetail:
    """PROGRESS in full, with its FRONT, a page of MEASUREMENTS, and the address of the FOLLOWING page."""
    row = progress.exploration
    return ExplorationDetail(
        **_summary(progress),
        space=row.space,
        sequence_sha256=row.sequence_sha256,
        objectives=row.objectives,
        limits=row.limits,
        frames=row.frames,
        command=public(row.command),
        note=public(row.note),
        front=[_front_point(row, point) for point in front],
        measurements=[_evaluation(evaluation) for evaluation in measurements],
        next=following,
    )


def _summary(progress: Progress) -> dict[str, Any]:
    row = progress.exploration
    return {
        "id": row.pk,
        "application": row.application,
        "sequence": row.sequence,
        "reference_device": row.reference_device.name,
        "method": row.method,
        "seed": row.seed,
        "budget": row.budget,
        "state": row.state,
        "evaluations": {
            "pending": progress.pending,
            "running": progress.running,
            "done": progress.done,
            "failed": progress.failed,
        },
        "created_at": row.created_at,
        "finished_at": row.finished_at,
    }


def _evaluation(row: Evaluation) -> EvaluationAnswer:
    return EvaluationAnswer(
        number=row.number,
        phase=row.phase,
        label=row.label,
        state=row.state,
        configuration=row.configuration,
        objectives=row.objectives,
        stages=row.stages,
        error=public(row.error),
        device=row.device,
        software=row.software,
        finished_at=row.finished_at,
    )


def _front_point(exploration: Exploration, point: Point) -> FrontPoint:
    return FrontPoint(
        configuration=point.configuration,
        label=point.label,
        phase=point.phase,
        objectives=point.values,
        measurements=point.measurements,
        frames=None if point.whole else exploration.frames,
    )
