"""The race: the frames that the default and another configuration compute in the same time, in two lanes."""

import math
from dataclasses import dataclass

from wire.front import BEST, DEFAULT

WIDTH = 1000.0
# More blocks in a lane cannot be distinguished on a phone.
MOST_BLOCKS = 60
MOST_DEFAULT_BLOCKS = 4


@dataclass(frozen=True)
class Block:
    """A frame in a lane: its start and duration, in units of `width` per race."""

    x: float
    width: float


@dataclass(frozen=True)
class Lane:
    """The frames of a configuration; `frames` includes the fraction of the last one.

    `kind` is "default", or "best" for the other configuration.
    """

    kind: str
    name: str
    frames: float
    blocks: tuple[Block, ...]


def race(speedup: float | None, configuration: str = BEST) -> tuple[Lane, Lane] | None:
    """The lanes of default and `configuration` over the time of a few default frames.

    None without a positive speedup. No lane has more than MOST_BLOCKS blocks, if possible.
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
