"""Searches as pages show them: over the space that ships, with figures that a test chooses."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pareto
from crowd.explorations import services
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.models import Exploration
from tests.builders.explorations import record, unsaved_exploration

SPACE = json.loads((Path(pareto.__file__).parent / "spaces" / "kfusion.json").read_text())
# Of the five configurations that are known before: STANDARD, then the app's four fast ones; None fails.
KNOWN = [(0.02, 0.1), (0.04, 0.02), (0.2, 0.03), (0.3, 0.04), None]


def exploration(pack: dict[str, Any], budget: int = 4) -> Exploration:
    """A random search of `budget` configurations over `pack` on a made-up device, nothing measured yet."""
    changes = {"space": SPACE, "objectives": ["runtime", "ate_max"], "points": 12, "repeats": 0}
    return services.create(unsaved_exploration(pack, "test-board", budget=budget, batch=budget, **changes))


def measure(search: Exploration, results: Iterable[tuple[float, float] | None]) -> None:
    """Measure the waiting evaluations: (max ATE in metres, seconds a frame), or None for a failure."""
    services.advance(search.pk)
    for waiting, result in zip(services.pending_evaluations(search), results, strict=True):
        if result is None:
            record(waiting, "the process ended with signal 6")
        else:
            ate, runtime = result
            objectives = {"runtime": runtime, "ate_max": ate, "ate_mean": ate / 2}
            record(waiting, Measurement(objectives, {"computation": runtime}, {"name": "test"}))
