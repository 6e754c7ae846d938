"""Explorations made through their services, with measurements that are made up for testing."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pareto
from crowd.explorations import services
from crowd.explorations.measuring import leases
from crowd.explorations.measuring.measurement import Measurement, MeasurementError
from crowd.explorations.models import Evaluation, Exploration, ReferenceDevice

SPACE = json.loads((Path(pareto.__file__).parent / "spaces" / "kfusion.json").read_text())
# Of the five configurations that are known before: STANDARD, then the app's four fast ones; None fails.
KNOWN = [(0.02, 0.1), (0.04, 0.02), (0.2, 0.03), (0.3, 0.04), None]


def exploration(pack: dict[str, Any], budget: int = 4) -> Exploration:
    """A random search of `budget` configurations over `pack` on a made-up device, nothing measured yet."""
    device, _ = ReferenceDevice.objects.get_or_create(name="test-board", queue="test-board")
    return services.create(
        Exploration(
            space=SPACE,
            sequence=pack["name"],
            sequence_sha256=pack["sha256"],
            reference_device=device,
            objectives=["runtime", "ate_max"],
            limits={"ate_max": 0.05},
            method="random",
            budget=budget,
            batch=budget,
            repeats=0,
        )
    )


def measure(search: Exploration, results: Iterable[tuple[float, float] | None]) -> None:
    """Measure the waiting evaluations: (max ATE in metres, seconds a frame), or None for a failure."""
    services.advance(search.pk)
    for waiting, result in zip(services.pending_evaluations(search), results, strict=True):
        with leases.leased(waiting.pk) as evaluation:
            assert isinstance(evaluation, Evaluation)
            if result is None:
                raise MeasurementError("the process ended with signal 6")
            ate, runtime = result
            objectives = {"runtime": runtime, "ate_max": ate, "ate_mean": ate / 2}
            leases.record(evaluation, Measurement(objectives, {"computation": runtime}, {"name": "test"}))
