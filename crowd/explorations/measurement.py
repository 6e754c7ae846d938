"""Measuring one evaluation on this machine, by slam or by whatever the settings name instead."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from django.conf import settings
from django.utils.module_loading import import_string

from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts import sequences
from crowd.fronts.contents import needs_colour
from slam import isolated
from slam.isolated import CannotMeasureHereError, LeaseLostError, Measurement, MeasurementError

Heartbeat = Callable[[], bool]
Evaluator = Callable[[Evaluation, Heartbeat | None], Measurement]

__all__ = [
    "CannotMeasureHereError",
    "LeaseLostError",
    "Measurement",
    "MeasurementError",
    "evaluator",
    "measure",
    "pack_of",
]


def evaluator() -> Evaluator:
    """What FRONTRUNNER_EVALUATOR names: `measure`, unless tests or another kind of system replace it."""
    return _imported(settings.FRONTRUNNER_EVALUATOR)


@cache
def _imported(path: str) -> Evaluator:
    found: Evaluator = import_string(path)
    return found


def measure(evaluation: Evaluation, heartbeat: Heartbeat | None = None) -> Measurement:
    """Measure EVALUATION's configuration in a fresh process; HEARTBEAT and errors as in `slam.isolated`.

    Raises CannotMeasureHereError, too, where the sequence is not on this machine.
    """
    exploration = evaluation.exploration
    return isolated.measure(
        exploration.application,
        evaluation.configuration,
        pack_of(exploration)[0],
        device=exploration.reference_device.opencl_device,
        backend=exploration.reference_device.backend,
        frames=evaluation.frames,
        heartbeat=heartbeat,
        heartbeat_seconds=settings.FRONTRUNNER_HEARTBEAT_SECONDS,
        timeout=settings.FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS,
    )


def pack_of(exploration: Exploration) -> tuple[Path, dict[str, Any]]:
    """The folder of the exploration's sequence and its description, with its colour's where that is needed.

    Raises CannotMeasureHereError where this machine has no such pack, another name or other content, or
    lacks its colour.
    """
    for pack in sequences.packs():
        description = sequences.described(pack)
        if (description["name"], description["sha256"]) == (
            exploration.sequence,
            exploration.sequence_sha256,
        ):
            try:
                return pack, sequences.described(pack, needs_colour(exploration.application))
            except sequences.SequenceError as error:
                raise CannotMeasureHereError(str(error)) from error
    raise CannotMeasureHereError(
        f"no pack {exploration.sequence} with digest {exploration.sequence_sha256[:12]}... on this machine: "
        "put it into one of the sequence folders"
    )
