"""Schemas of the responses about explorations."""

from collections.abc import Iterable
from datetime import datetime
from typing import Any

import msgspec

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.public_rows import public_row
from crowd.explorations.searching.points import Point
from crowd.explorations.selectors import Progress
from crowd.records.record import answer, fill
from slam.public_text import without_folders
from wire.evaluation import EvaluationRow
from wire.exploration import Pack, Settings

IN_DETAIL = ("space", "sequence_sha256", "error_quantile", "objectives", "limits", "frames", "command")


class Elsewhere(msgspec.Struct):
    """Where an imported exploration was measured: the `machine` of another server, and its device's name."""

    machine: str
    device: str


class ExplorationSummary(answer(Settings, IN_DETAIL)):  # type: ignore[misc]
    """An exploration in a list. Evaluations are counted by state.

    `measured_elsewhere` is null if this server's reference device measured it.
    """

    id: int
    reference_device: str
    measured_elsewhere: Elsewhere | None
    state: str
    evaluations: dict[str, int]
    finished_at: datetime | None


class ExplorationPage(msgspec.Struct):
    """Explorations, newest first."""

    results: list[ExplorationSummary]
    next: str | None


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


class ExplorationDetail(answer(Settings, base=ExplorationSummary)):  # type: ignore[misc]
    """An exploration with a page of `measurements`; `next` is the address of the following page, or null.

    The search learns on `sequences`; clients measure on the first, `sequence`. The error at `error_quantile`
    of those on the sequences counts; 1 is the worst. Only repeats run over `held_out`. The front is that of
    measurements over the whole sequence; before there are any, that of the search. `note`: why it paused by
    itself, or why a machine cannot measure.
    """

    sequences: list[Pack]
    held_out: list[Pack]
    note: str
    front: list[FrontPoint]
    measurements: list[EvaluationAnswer]
    next: str | None


def summary(progress: Progress) -> ExplorationSummary:
    """`progress` as JSON in a list."""
    return fill(ExplorationSummary, progress.exploration, **_state(progress))


def detail(
    progress: Progress, front: Iterable[Point], measurements: Iterable[Evaluation], following: str | None
) -> ExplorationDetail:
    """`progress` with its `front`, a page of `measurements`, and the address of the `following` page."""
    row = progress.exploration
    return fill(
        ExplorationDetail,
        row,
        **_state(progress),
        sequences=[Pack(**pack) for pack in row.learned_on],
        held_out=[Pack(**pack) for pack in row.held_out_sequences],
        command=without_folders(row.command),
        note=without_folders(row.note),
        front=[_front_point(row, point) for point in front],
        measurements=[fill(EvaluationAnswer, public_row(evaluation)) for evaluation in measurements],
        next=following,
    )


def _state(progress: Progress) -> dict[str, Any]:
    row = progress.exploration
    device = row.reference_device
    return {
        "id": row.pk,
        "reference_device": device.name,
        "measured_elsewhere": Elsewhere(device.elsewhere, device.opencl_device) if device.elsewhere else None,
        "state": row.state,
        "evaluations": {
            "pending": progress.pending,
            "running": progress.running,
            "done": progress.done,
            "failed": progress.failed,
        },
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
