"""What a search asks of a server of workers: the programs that run it on several hosts are not known here."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pareto.measuring.measurements import Feasible
from pareto.measuring.pool import Conditions, Resources
from pareto.search.explorer import Explorer
from pareto.spaces.space import Configuration


@dataclass(frozen=True)
class Hosting:
    """A search that workers measure for: where it listens, its folder and command, how many run at once.

    A program that must end gets `grace` seconds between SIGTERM and SIGKILL.
    """

    host: str
    port: int
    folder: Path
    command: str
    explorer: Explorer
    feasible: Feasible | None
    timeout: float | None
    grace: float
    jobs: int


class Hosted(Protocol):
    """Measures like a program, on other hosts."""

    def __call__(
        self, configuration: Configuration, resources: Resources, conditions: Conditions, /
    ) -> dict[str, float]:
        """Return the values of `configuration` as a program does. Raises EvaluationError."""

    def end(self) -> None:
        """Wait for no more results."""


Host = Callable[[Hosting], AbstractContextManager[Hosted]]
