"""Real measurements, with the processor's time in place of the clock's, which other tests disturb."""

from dataclasses import replace
from typing import Any

from crowd.explorations.measuring import measurement
from crowd.explorations.measuring.measurement import Heartbeat, Measurement
from crowd.explorations.models import Evaluation


def measure(evaluation: Evaluation, heartbeat: Heartbeat | None = None) -> Measurement:
    """`evaluation`, whose `runtime` is processor time, and whose threads never waited."""
    found = measurement.measure(evaluation, heartbeat)
    parts = tuple(_by_processor(part) for part in found.parts)
    return replace(found, objectives=_by_processor(found.objectives), parts=parts)


def _by_processor(values: dict[str, Any]) -> dict[str, Any]:
    undisturbed = {"runtime": values.get("cpu_seconds"), "waited_seconds": 0.0}
    return values | (undisturbed if "cpu_seconds" in values else {})
