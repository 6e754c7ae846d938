"""Measurements looked up in a table instead of made, and notes of when each began and ended."""

import itertools
import os
import time
from collections.abc import Callable

from django.conf import settings

from crowd.explorations.measuring.measurement import Measurement, MeasurementError
from crowd.explorations.models import Evaluation
from tests.services import notes
from tests.services.notes import Note

SIZES = {"coarseness": 8, "depth": 8, "steps": 8, "width": 8}
SPACE = {
    "name": "table",
    "parameters": [
        {"name": name, "type": "ordinal", "values": list(range(1, size + 1)), "default": 4}
        for name, size in SIZES.items()
    ],
}
FAILING = 29  # every so many rows
NOTHING = "the table holds nothing here"


def _row(place: int, values: tuple[int, ...]) -> dict[str, float] | None:
    """Time against error with ripples, so that there is a front to find; some rows hold nothing."""
    if place % FAILING == 0:
        return None
    coarseness, depth, steps, width = values
    runtime = 0.2 / coarseness + 0.004 * depth * (1 + (width % 3)) + 0.002 * steps
    error = 0.002 * coarseness**1.5 + 0.05 / (depth + steps) + 0.001 * (width % 5)
    return {"runtime": runtime, "ate_max": error, "ate_mean": error / 2, "ate_rmse": error / 2}


TABLE = {
    values: _row(place, values)
    for place, values in enumerate(itertools.product(*(range(1, size + 1) for size in SIZES.values())))
}
DEVICE = {"platform": "table", "name": "Table", "driver": "1", "backend": "table"}


def look_up(configuration: dict[str, int]) -> dict[str, float] | None:
    """The row of `configuration`; None where the table holds nothing."""
    return TABLE[tuple(configuration[name] for name in SIZES)]


def measure(evaluation: Evaluation, heartbeat: Callable[[], bool] | None = None) -> Measurement:
    """As crowd.explorations.measuring.measurement.measure does, after TABLE_SECONDS."""
    _note(evaluation, "begun")
    time.sleep(settings.TABLE_SECONDS)
    objectives = look_up(evaluation.configuration)
    _note(evaluation, "ended")
    if objectives is None:
        raise MeasurementError(NOTHING)
    return Measurement(objectives, {"computation": objectives["runtime"]}, DEVICE)


def _note(evaluation: Evaluation, what: str) -> None:
    notes.add(settings.FRONTRUNNER_VAR, Note(evaluation.pk, evaluation.attempt, os.getpid(), what))
