"""The interface of every executor of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from slam.plans.plan import Dispatch, Plan, State


@dataclass(frozen=True)
class Outcome:
    """The outcome of one frame: the state after it, and seconds.

    `computation` is the wall time from the first upload until the state was read back. `stages` is the
    device's time by stage, empty where it has no clock; stages in which nothing was launched took 0.
    """

    state: State
    computation: float
    stages: Mapping[str, float]


class Execution(Protocol):
    """A plan on a device, ready for its first frame."""

    plan: Plan
    stage_clock: str

    def run(self, number: int, image: npt.NDArray[np.uint16] | None = None) -> Outcome:
        """Launch what takes place in frame `number` over `image`, and wait for the state. None keeps the last
        image.
        """

    def read(self, name: str, first: int = 0, count: int | None = None) -> npt.NDArray[Any]:
        """`count` values (default all) of the buffer `name` from `first` on: (planes, count); the state is
        ()."""

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        """Replace the content of the buffer `name` by `values` (planes, count), or the state by ()."""


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
