"""A small design space in place of a SLAM system's, and a made-up program to measure in it."""

from __future__ import annotations

from frontrunner.paper.budget import Study
from pareto import Space
from slam.isolated import MeasurementError
from tests.pareto import searches


class ToyStudy(Study):
    """Searches the toy space; the system gives no more than its name."""

    def space(self) -> Space:
        return searches.SPACE


def study(random: int = 12, batch: int | None = 3, iterations: int | None = 4, **more) -> ToyStudy:
    return ToyStudy("kfusion", random, batch, iterations, **more)


class Program:
    """Measures the toy program, and remembers what; it stops like a user's Ctrl-C after `most` runs."""

    def __init__(self, most: int | None = None) -> None:
        self.most = most
        self.measured: list[dict[str, object]] = []

    def __call__(self, configuration: dict[str, object]) -> dict[str, float]:
        if len(self.measured) == self.most:
            raise KeyboardInterrupt
        self.measured.append(configuration)
        values = searches.measure(configuration)
        if values is None:
            raise MeasurementError("exit code 1: it crashed")
        return {"ate_max": values["error"] / 4, "runtime": values["seconds"]}
