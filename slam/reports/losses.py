"""When a camera was lost: from the frames of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

MOST_LISTED = 5


@dataclass(frozen=True)
class Loss:
    """Lost frames that follow each other, `count` of them, from `first` on.

    `found` is the frame that was tracked again, None where none was. `reason` is the refusal of the first
    lost frame, None where the system gives none.
    """

    first: int
    count: int
    found: int | None
    reason: str | None

    def __str__(self) -> str:
        frames = f"{self.count} frame" + "s" * (self.count > 1)
        end = "not found again" if self.found is None else f"found again in frame {self.found}"
        return f"frame {self.first}, for {frames}, {end}" + (f": {self.reason}" if self.reason else "")


def losses(frames: Sequence[Mapping[str, Any]]) -> list[Loss]:
    """The losses in the `frames` of a report, in their order. Frames without an attempt do not end one."""
    ended: list[Loss] = []
    lost: list[int] = []
    for number, frame in enumerate(frames):
        if frame["tracked"] is False:
            lost.append(number)
        elif frame["tracked"] and lost:
            ended.append(_loss(frames, lost, number))
            lost = []
    return [*ended, _loss(frames, lost, None)] if lost else ended


def _loss(frames: Sequence[Mapping[str, Any]], lost: Sequence[int], found: int | None) -> Loss:
    return Loss(lost[0], len(lost), found, frames[lost[0]]["refusal"])


def lines(frames: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line for each loss, at most MOST_LISTED, and one that counts the others."""
    all_losses = losses(frames)
    more = len(all_losses) - MOST_LISTED
    return [str(loss) for loss in all_losses[:MOST_LISTED]] + ([f"and {more} more"] if more > 0 else [])
