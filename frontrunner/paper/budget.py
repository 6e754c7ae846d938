"""What is measured, and how much of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pareto
from frontrunner.paper import published
from groundwork.folders import SEQUENCES
from pareto.spaces.space import Space
from slam.definitions import definition
from slam.reports.surface import Grid

SEQUENCE = SEQUENCES / "living-room"  # of every measurement; its colour lies beside it
SPACES = Path(pareto.__file__).parent / "spaces"
DEFAULT = "default"  # the label of a space's default configuration


@dataclass(frozen=True)
class Study:
    """A design space searched by Algorithm 1: `random` samples, then the predicted front.

    In each iteration at most `batch` points of it are measured, in at most so many `iterations`; None is the
    paper's: all of it, until nothing of it is left. `references` are configurations measured besides, by
    label; `frames` of the sequence are run, all where None.
    """

    system: str
    random: int
    batch: int | None = None
    iterations: int | None = None
    references: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    frames: int | None = None

    @property
    def title(self) -> str:
        """The system's name in papers."""
        return definition(self.system).title

    @property
    def active(self) -> int | None:
        """The most points measured by active learning; None without a limit."""
        return None if self.batch is None or self.iterations is None else self.batch * self.iterations

    def space(self) -> Space:
        """The design space of the system."""
        return Space.load(SPACES / f"{self.system}.json")

    def configurations(self) -> dict[str, Mapping[str, Any]]:
        """The default and the references, by label."""
        default = self.space().default
        return {
            DEFAULT: default,
            **{label: default | dict(known) for label, known in self.references.items()},
        }


@dataclass(frozen=True)
class SurfaceStudy:
    """A grid of two parameters of KinectFusion, in `rounds` over the first `frames` (all where None)."""

    grid: Grid
    rounds: int
    frames: int | None

    @property
    def runs(self) -> int:
        """The number of measurements."""
        return self.rounds * len(self.grid.x_values) * len(self.grid.y_values)


@dataclass(frozen=True)
class Budget:
    """All that is measured."""

    kfusion: Study
    elasticfusion: Study
    surface: SurfaceStudy


GRID = Grid(
    "mu",
    "icp_threshold",
    (0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4),
    (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0),
)


REFERENCES: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "kfusion": {"STANDARD": definition("kfusion").known["STANDARD"]},
    "elasticfusion": published.ELASTICFUSION_KNOWN,
}


def _study(system: str, random: int, batch: int | None = None, iterations: int | None = None) -> Study:
    return Study(system, random, batch, iterations, REFERENCES[system])


BUDGETS = {
    "small": Budget(
        _study("kfusion", 300, 30, 6),
        _study("elasticfusion", 100, 20, 2),
        SurfaceStudy(GRID, rounds=5, frames=25),
    ),
    "full": Budget(
        _study("kfusion", published.RANDOM["ODROID-XU3"]),
        _study("elasticfusion", published.ELASTICFUSION_RANDOM),
        SurfaceStudy(GRID, rounds=5, frames=None),
    ),
}
