"""The interface of every executor of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from time import perf_counter
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from slam.plans.plan import Dispatch, Plan, State


@dataclass(frozen=True)
class Outcome:
    """The outcome of one frame: the state after it, and seconds.

    `computation` is the wall time from the first upload until the state was read back. `stages` is the
    device's time by stage, empty where it has no clock; stages in which nothing was launched took 0.
    `skipped`: nothing was done, the plan said before where the camera would be.
    """

    state: State
    computation: float
    stages: Mapping[str, float]
    skipped: bool = False


class Execution(Protocol):
    """A plan on a device, ready for its first frame."""

    plan: Plan
    stage_clock: str

    def run(self, number: int, image: npt.NDArray[np.uint16] | None = None) -> Outcome:
        """Launch what takes place in frame `number` over `image`, and wait for the state. None keeps the last
        image. A frame that the plan leaves out is served by `Leaving`.
        """

    def read(self, name: str, first: int = 0, count: int | None = None) -> npt.NDArray[Any]:
        """`count` values (default all) of the buffer `name` from `first` on: (planes, count); the state is
        ()."""

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        """Replace the content of the buffer `name` by `values` (planes, count), or the state by ()."""


class Leaving:
    """Serves the frames that a plan leaves out."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._served = 0  # since the state was read

    def outcome(self, state: State, began: float, stage_clock: str) -> Outcome | None:
        """The outcome of the next frame without any work, where `state` is the one read last; None where it
        is computed. `began` is when the frame did, by perf_counter."""
        served = self._plan.served(state, self._served)
        if served is None:
            self._served = 0
            return None
        self._served += 1
        stages = {} if stage_clock == "none" else dict.fromkeys(self._plan.stages, 0.0)
        return Outcome(served, perf_counter() - began, stages, skipped=True)


@dataclass(frozen=True)
class Segment:
    """Dispatches of one stage, one after another, that take place in the same frames."""

    stage: str
    dispatches: tuple[Dispatch, ...]

    def takes_place(self, number: int, before: State) -> bool:
        """Whether they are launched in frame `number`, where `before` is the state as last read."""
        return self.dispatches[0].takes_place(number, before)


def segments(plan: Plan) -> tuple[Segment, ...]:
    """The dispatches of `plan` in their order, those together that share their stage and their frames."""
    groups = groupby(plan.dispatches, key=attrgetter("stage", "frames"))
    return tuple(Segment(stage, tuple(dispatches)) for (stage, _), dispatches in groups)
