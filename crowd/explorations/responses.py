"""Schemas of the responses about explorations."""

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any

import msgspec

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.searching.points import Point
from crowd.explorations.selectors import Progress
from slam.isolated import NO_OBJECTIVES
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


class Part(msgspec.Struct):
    """The result on one sequence: objectives (units as in a measurement) and lost frames."""

    sequence: str
    lost: int
    objectives: dict[str, float]


class EvaluationAnswer(msgspec.Struct):
    """One measurement. Objectives: runtime in seconds a frame, ate_* in metres; null unless it is done.
    `phase`: why it is measured; empty until it is finished.

    `parts`: results by sequence, null for a single sequence. `censored`: not all sequences were run, so
    errors are at least this large. `perturbation`: the seed by which depth was changed by one unit, 0 for
    none.
    """

    number: int
    phase: str
    label: str
    state: str
    configuration: dict[str, Any]
    objectives: dict[str, float] | None
    parts: list[Part] | None
    censored: bool
    perturbation: int
    stages: dict[str, float] | None
    error: str
    device: dict[str, Any] | None
    software: str
    finished_at: datetime | None


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
    """PROGRESS as JSON in a list."""
    return ExplorationSummary(**_summary(progress))


def detail(
    progress: Progress, front: Iterable[Point], measurements: Iterable[Evaluation], following: str | None
) -> ExplorationDetail:
    """PROGRESS with its FRONT, a page of MEASUREMENTS, and the address of the FOLLOWING page."""
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
        measurements=[_evaluation(evaluation) for evaluation in measurements],
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


def _evaluation(row: Evaluation) -> EvaluationAnswer:
    return EvaluationAnswer(
        number=row.number,
        phase=row.public_phase,
        label=row.label,
        state=row.state,
        configuration=row.configuration,
        objectives=row.objectives,
        parts=None if row.parts is None else [_part(part) for part in row.parts],
        censored=row.censored,
        perturbation=row.perturbation,
        stages=row.stages,
        error=without_folders(row.error),
        device=row.device,
        software=row.software,
        finished_at=row.finished_at,
    )


def _part(part: Mapping[str, Any]) -> Part:
    objectives = {name: value for name, value in part.items() if name not in NO_OBJECTIVES}
    return Part(part["sequence"], part["lost"], objectives)


def _front_point(exploration: Exploration, point: Point) -> FrontPoint:
    return FrontPoint(
        configuration=point.configuration,
        label=point.label,
        phase=point.phase,
        objectives=point.values,
        measurements=point.measurements,
        frames=None if point.whole else exploration.frames,
    )
