"""The race: how many frames the default and another configuration compute in the same time, as two lanes of
blocks.
"""

import math
from dataclasses import dataclass

from crowd.fronts.selectors import BEST, DEFAULT

WIDTH = 1000.0
# More blocks than this in a lane melt together on a phone.
MOST_BLOCKS = 60
MOST_DEFAULT_BLOCKS = 4


@dataclass(frozen=True)
class Block:
    """One frame in a lane: where it starts and how long it takes, in units of WIDTH for the whole race."""

    x: float
    width: float


@dataclass(frozen=True)
class Lane:
    """One configuration's frames; `frames` counts the unfinished last one by its fraction. `kind` is the part
    it has: "default", or "best" for whichever runs against it.
    """

    kind: str
    name: str
    frames: float
    blocks: tuple[Block, ...]


def race(speedup: float | None, configuration: str = BEST) -> tuple[Lane, Lane] | None:
    """Lanes of default and CONFIGURATION over the time of a few default frames; None without a positive
    speedup.

    The time is chosen such that no lane has more than MOST_BLOCKS blocks where that is possible.
    """
    if speedup is None or not math.isfinite(speedup) or speedup <= 0:
        return None
    frames = max(1, min(MOST_DEFAULT_BLOCKS, math.floor(MOST_BLOCKS / speedup)))
    return _lane(DEFAULT, DEFAULT, float(frames)), _lane(BEST, configuration, frames * speedup)


def _lane(kind: str, name: str, frames: float) -> Lane:
    pitch = WIDTH / frames
    gap = min(4.0, pitch * 0.25)
    blocks = []
    for number in range(math.ceil(frames - 1e-9)):
        start = number * pitch
        blocks.append(Block(round(start, 2), round(min(pitch - gap, WIDTH - start), 2)))
    return Lane(kind, name, frames, tuple(blocks))
