"""Times of a front's configurations on the clients' sequence."""

from pathlib import Path
from typing import Any

import pytest

from slam.isolated import Measurement
from slam.references import times

POINTS: dict[str, dict[str, Any]] = {
    "default": {"mu": 0.1},
    **{f"point-{n}": {"mu": 0.1 + n / 100} for n in range(1, 11)},
}


class Machine:
    """A machine that gets slower from run to run."""

    def __init__(self) -> None:
        self.ran: list[float] = []

    def measure(self, system: str, configuration: Any, sequences: list[Path], *, frames: int) -> Measurement:
        assert (system, sequences, frames) == ("kfusion", [Path("room")], 20)
        self.ran.append(configuration["mu"])
        slowness = 1.0 + len(self.ran) / 1000
        seconds = slowness * (1.0 if configuration["mu"] == 0.1 else configuration["mu"])
        stages = {"tracking": 0.25 * seconds, "raycasting": 0.5 * seconds, "computation": seconds}
        return Measurement({"runtime": seconds}, stages, {"name": "a board", "driver": "1.0"})


def test_each_point_is_timed_beside_a_default_that_ran_lately() -> None:
    machine, seen = Machine(), []

    found, device = times.on_sequence(
        POINTS, Path("room"), 20, rounds=3, progress=lambda *at: seen.append(at), measure=machine.measure
    )

    assert found["default"] == {"runtime_ratio": 1.0, "stages": {"tracking": 0.25, "raycasting": 0.5}}
    assert found["point-9"]["runtime_ratio"] == pytest.approx(0.19, rel=0.01)
    assert found["point-9"]["stages"]["tracking"] == pytest.approx(0.19 / 4, rel=0.01)
    assert machine.ran.count(0.1) == 3 * 2  # before every eight of the ten points
    assert len(machine.ran) == 3 * 12
    assert seen[-1] == (36, 36)
    assert device == "a board, driver 1.0"
