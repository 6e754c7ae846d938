"""Schemas of the responses about explorations."""

from collections.abc import Iterable
from datetime import datetime
from typing import Any

import msgspec

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.public_rows import public_row
from crowd.explorations.searching.points import Point
from crowd.explorations.selectors import Progress
from crowd.records.evaluation import EvaluationRow
from crowd.records.record import answer, fill
from slam.public_text import without_folders


class Elsewhere(msgspec.Struct):
    """Where an imported exploration was measured: the `machine` of another server, and its device's name."""

    machine: str
    device: str


class ExplorationSummary(msgspec.Struct):
    """An exploration in a list. Evaluations are counted by state.

    `measured_elsewhere` is null if this server's reference device measured it.
    """

    id: int
    application: str
    sequence: str
    reference_device: str
    measured_elsewhere: Elsewhere | None
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


class Pack(msgspec.Struct):
    """A sequence by its name and digest."""

    name: str
    sha256: str


class EvaluationAnswer(answer(EvaluationRow)):  # type: ignore[misc]
    """One measurement. Objectives: runtime in seconds a frame, ate_* in metres; null unless it is done."""


class FrontPoint(msgspec.Struct):
    """A point of the front: medians over its measurements.

    `frames`: frames of each measurement, null for the whole sequence. It is the same for all points.
    """

    configuration: dict[str, Any]
    label: str
    phase: str
    objectives: dict[str, float]
    measurements: int
    frames: int | None


class ExplorationDetail(ExplorationSummary):
    """An exploration with a page of `measurements`; `next` is the address of the following page, or null.

    The search learns on `sequences`; clients measure on the first, `sequence`. The error at `error_quantile`
    of those on the sequences counts; 1 is the worst. Only repeats run over `held_out`. The front is that of
    measurements over the whole sequence; before there are any, that of the search. `note`: why it paused by
    itself, or why a machine cannot measure.
    """

    space: dict[str, Any]
    sequence_sha256: str
    sequences: list[Pack]
    held_out: list[Pack]
    error_quantile: float
    objectives: list[str]
    limits: dict[str, float]
    frames: int | None
    command: str
    note: str
    front: list[FrontPoint]
    measurements: list[EvaluationAnswer]
    next: str | None


def summary(progress: Progress) -> ExplorationSummary:
    """`progress` as JSON in a list."""
    return ExplorationSummary(**_summary(progress))


def detail(
    progress: Progress, front: Iterable[Point], measurements: Iterable[Evaluation], following: str | None
) -> ExplorationDetail:
    """`progress` with its `front`, a page of `measurements`, and the address of the `following` page."""
    row = progress.exploration
    return ExplorationDetail(
        **_summary(progress),
        space=row.space,
        sequence_sha256=row.sequence_sha256,
        sequences=[Pack(**pack) for pack in row.learned_on],
        held_out=[Pack(**pack) for pack in row.held_out_sequences],
        error_quantile=row.error_quantile,
        objectives=row.objectives,
        limits=row.limits,
        frames=row.frames,
        command=without_folders(row.command),
        note=without_folders(row.note),
        front=[_front_point(row, point) for point in front],
        measurements=[fill(EvaluationAnswer, public_row(evaluation)) for evaluation in measurements],
        next=following,
    )


def _summary(progress: Progress) -> dict[str, Any]:
    row = progress.exploration
    device = row.reference_device
    return {
        "id": row.pk,
        "application": row.application,
        "sequence": row.sequence,
        "reference_device": device.name,
        "measured_elsewhere": Elsewhere(device.elsewhere, device.opencl_device) if device.elsewhere else None,
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


def _front_point(exploration: Exploration, point: Point) -> FrontPoint:
    return FrontPoint(
        configuration=point.configuration,
        label=point.label,
        phase=point.phase,
        objectives=point.values,
        measurements=point.measurements,
        frames=None if point.whole else exploration.frames,
    )
