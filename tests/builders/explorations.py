"""Explorations made through their services, with measurements that are made up for testing."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pareto
from crowd.explorations import services
from crowd.explorations.measuring import leases
from crowd.explorations.measuring.measurement import (
    Measurement,
    MeasurementError,
    sequence_names,
    stop_after,
)
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice
from crowd.fronts.content import plans
from pareto import Space
from slam import isolated
from slam.stopping import find_broken

SPACE = {
    "name": "small",
    "parameters": [
        {"name": "compute_size_ratio", "type": "ordinal", "values": [1, 2, 4], "default": 2},
        {"name": "integration_rate", "type": "ordinal", "values": [1, 2, 5, 20], "default": 2},
        {"name": "tracking_rate", "type": "ordinal", "values": [1, 2, 9], "default": 1},
        {"name": "volume_resolution", "type": "ordinal", "values": [32, 64], "default": 64},
    ],
}
# How many times as large errors on a sequence are.
FACTORS = {"tiny": 1.0, "desk": 2.0, "attic": 4.0, "library": 8.0}


def shipped_space(name: str = "kfusion") -> dict[str, Any]:
    """The space of that name that ships, as an exploration stores it."""
    return Space.load(Path(pareto.__file__).parent / "spaces" / f"{name}.json").to_dict()


def unsaved_exploration(pack: Mapping[str, Any], device: str = "bench", **changes: Any) -> Exploration:
    """A random search over `pack` and the small space that could be created."""
    board, _ = ReferenceDevice.objects.get_or_create(name=device, queue=device)
    fields = {
        "space": SPACE,
        "sequence": pack["name"],
        "sequence_sha256": pack["sha256"],
        "reference_device": board,
        "objectives": ["ate_max", "runtime"],
        "limits": {"ate_max": 0.05},
        "method": "random",
        "budget": 6,
        "batch": 4,
        "points": 3,
        "repeats": 2,
    }
    return Exploration(**fields | changes)


def changed(exploration: Exploration, **changes: Any) -> Exploration:
    """`exploration` with other values, not stored."""
    for name, value in changes.items():
        setattr(exploration, name, value)
    return exploration


def measurement(configuration: dict[str, Any]) -> Measurement:
    """What some machine might measure; the error grows as the time shrinks."""
    ratio, rate = configuration["compute_size_ratio"], configuration["tracking_rate"]
    runtime = (0.1 / ratio**2 + 0.02 / configuration["integration_rate"]) * (1 + 0.1 / rate)
    error = 0.002 * ratio * rate * (1 + 0.01 * configuration["integration_rate"])
    objectives = {"runtime": runtime, "ate_max": error, "ate_mean": error / 2, "ate_rmse": error / 2}
    stages = {"preprocessing": runtime / 2, "tracking": runtime / 2, "integration": 0.0, "raycasting": 0.0}
    device = {"platform": "p", "name": "Bench CPU", "driver": "1.0", "backend": "opencl"}
    return Measurement(objectives, stages, device)


def reference(evaluation: Evaluation) -> dict[str, Any]:
    """What some machine's devices might say of the evaluation's configuration: they hardly differ."""
    exploration = evaluation.exploration
    return {
        "trajectory": [[0.01 * frame, 0.5, 0.1] for frame in range(evaluation.frames or 0)],
        "band": 0.002,
        "largest_deviation": 0.0003,
        "variants": ["Bench CPU 1.0, rows", "Bench CPU 1.0, pixels"],
        "program": plans.program_digest(
            exploration.application, exploration.sequence_sha256, evaluation.configuration
        ),
    }


def measured_on(evaluation: Evaluation) -> Measurement:
    """What some machine might measure on the evaluation's sequences, errors FACTORS times as large."""
    above = 0
    found = measurement(evaluation.configuration)
    if evaluation.phase == Evaluation.Phase.REFERENCE:
        return replace(found, reference=reference(evaluation))
    parts: list[dict[str, Any]] = []
    for pack in sequence_names(evaluation):
        factor = FACTORS[pack["name"]]
        values = {
            name: factor * value if name.startswith("ate_") else value
            for name, value in found.objectives.items()
        }
        parts.append({"sequence": pack["name"], "lost": 0, "stopped_at": None, **values})
        above += find_broken(evaluation.stop_above, values) is not None
        if above == stop_after(evaluation):
            break
    return Measurement(isolated.combine(parts), found.stages, found.device, tuple(parts))


def record(waiting: Evaluation, result: Measurement | str | None = None, worker: str = "") -> None:
    """Store `result`, by default what some machine might measure, or a failure with that reason."""
    with leases.leased(waiting.pk, worker) as evaluation:
        assert isinstance(evaluation, Evaluation)
        if isinstance(result, str):
            raise MeasurementError(result)
        assert leases.record(evaluation, result or measured_on(evaluation))


def finish(evaluations: Iterable[Evaluation]) -> None:
    """Record a measurement for each."""
    for waiting in evaluations:
        record(waiting)


def run_to_the_end(exploration: Exploration) -> Exploration:
    """Measure whatever is asked for until nothing is."""
    while waiting := services.pending_evaluations(exploration) or services.advance(exploration.pk):
        finish(waiting)
    exploration.refresh_from_db()
    return exploration
