"""The work of a configuration in a frame, from its plan: the basis of predicted times."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

from slam.plans.plan import Dispatch, Plan

RESOURCES = {
    "preprocessing": "filtered pixels",
    "tracking": "tracked pixels",
    "integration": "voxels",
    "raycasting": "rays",
}
FRAMES, LAUNCHES, STEPS = "frames", "launches", "ray steps"
# By kernel: the arguments whose product is the number of steps of each work-item.
WALKED = {"integrate": ("resolution",) * 3, "track": ("width", "height")}
OTHER = "other"  # outside of all stages

Work = dict[tuple[str, str], float]


def work(plan: Plan, frames: Iterable[int]) -> Work:
    """Units of each (stage, resource) that PLAN uses in a frame, on average over the numbers FRAMES.

    A unit is a work-item of the layout by pixels: a pixel filtered (once for each kernel that does so), a
    pixel tracked (once an iteration, as if none ended early), a voxel, a ray. A ray has as many steps as
    reach through a metre of empty space. A launch and a frame cost time of their own.
    """
    numbers = list(frames)
    found: dict[tuple[str, str], float] = defaultdict(float)
    found[OTHER, FRAMES] = 1.0
    for dispatch in plan.dispatches:
        share = sum(dispatch.takes_place(number) for number in numbers) / len(numbers)
        items = share * _items(dispatch)
        found[dispatch.stage, LAUNCHES] += share
        found[dispatch.stage, RESOURCES[dispatch.stage]] += items
        if "large_step" in dispatch.arguments:
            found[dispatch.stage, STEPS] += items / float(str(dispatch.arguments["large_step"]))
    return dict(found)


def _items(dispatch: Dispatch) -> float:
    """Work-items, or what they walk through: the voxels of a column, the pixels that are summed."""
    walked = [float(str(dispatch.arguments[name])) for name in WALKED.get(dispatch.kernel, ())]
    return math.prod(walked) if walked else float(math.prod(dispatch.size))
