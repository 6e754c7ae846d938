"""Shapes of the answers about explorations."""

from datetime import datetime
from typing import Any

import msgspec

from crowd.explorations.models import Evaluation
from crowd.explorations.points import Point
from crowd.explorations.selectors import Detail, Progress


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
    """A point of the front: medians over its measurements."""

    configuration: dict[str, Any]
    label: str
    phase: str
    objectives: dict[str, float]
    measurements: int


class ExplorationDetail(ExplorationSummary):
    """An exploration in full."""

    space: dict[str, Any]
    sequence_sha256: str
    objectives: list[str]
    limits: dict[str, float]
    command: str
    front: list[FrontPoint]
    measurements: list[EvaluationAnswer]


def summary(progress: Progress) -> ExplorationSummary:
    """PROGRESS in a list."""
    return ExplorationSummary(**_summary(progress))


def detail(found: Detail) -> ExplorationDetail:
    """FOUND in full."""
    row = found.progress.exploration
    return ExplorationDetail(
        **_summary(found.progress),
        space=row.space,
        sequence_sha256=row.sequence_sha256,
        objectives=row.objectives,
        limits=row.limits,
        command=row.command,
        front=[_front_point(point) for point in found.front],
        measurements=[_evaluation(evaluation) for evaluation in found.evaluations],
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
        error=row.error,
        device=row.device,
        software=row.software,
        finished_at=row.finished_at,
    )


def _front_point(point: Point) -> FrontPoint:
    return FrontPoint(point.configuration, point.label, point.phase, point.values, point.measurements)
