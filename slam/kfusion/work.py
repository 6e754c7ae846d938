"""The work of a configuration in a frame, from its plan: the basis of predicted times and of the largest
possible speedup.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

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
ITERATING = "iterating"  # the flag of launches that do nothing once a level has converged
FUSING = "fusing"  # the member of the state before a frame that the camera's motion chose for fusing
RAY_STEPS = frozenset({"small_step", "large_step"})  # lengths (m) near the surface, and in empty space

Work = dict[tuple[str, str], float]
# By stage: the least and the most, of times that it may be faster, or of a frame's time.
StageRanges = Mapping[str, tuple[float, float]]
# Caches make a stage up to 1.2 times as fast as its work says: docs/research/work-bound.md.
LOG_WORK_MARGIN = math.log(2)
# Stages take other shares of a frame on other devices. On 12 of them: up to 3.3 times the reference's.
REFERENCE_MARGIN = 4.0


def work(plan: Plan, frames: Iterable[int], skipped: float = 0.0) -> Work:
    """Units of each (stage, resource) that `plan` uses in a frame, on average over the numbers `frames`.

    A unit is a work-item of the layout by pixels: a pixel filtered (once for each kernel that does so), a
    pixel tracked (once an iteration, as if none ended early), a voxel, a ray. A ray has as many steps as
    reach through a metre of empty space. A launch and a frame cost time of their own. The share `skipped` of
    the frames is left out and uses nothing; where motion chooses what is fused, all others are fused.
    """
    numbers = list(frames)
    units: dict[tuple[str, str], float] = defaultdict(float)
    units[OTHER, FRAMES] = 1.0 - skipped
    for dispatch in plan.dispatches:
        share = (1.0 - skipped) * _share(dispatch, numbers, fusing=True)
        items = share * _items(dispatch)
        units[dispatch.stage, LAUNCHES] += share
        units[dispatch.stage, RESOURCES[dispatch.stage]] += items
        if "large_step" in dispatch.arguments:
            units[dispatch.stage, STEPS] += items / float(str(dispatch.arguments["large_step"]))
    return dict(units)


def stage_ratios(
    default: Plan, other: Plan, frames: Iterable[int], skipped: float | None = None
) -> StageRanges:
    """How many times faster each stage of `other` may be than that of `default`, over the numbers `frames`.

    `skipped`: the share of them that `other` leaves out. None: its limit decides.

    A device spends the time of a stage on any of its kernels, on the steps of rays, or on launches: the ratio
    lies between the smallest and the largest of theirs. The work of `default` counts in full. That of `other`
    is at least one iteration for each level that has any, because ICP may end early, and at most all; and
    where motion chooses the frames that are fused, at least none and at most all. The frame itself, "other",
    takes the same time with both, unless it is left out. Infinite for a stage that `other` never runs.
    """
    numbers = list(frames)
    limit = int(str(other.configuration.get("skip_limit", 0)))
    computed = 1.0 - (limit / (limit + 1) if skipped is None else skipped)
    before, full, least = (
        _work_by_kernel(plan, numbers, ends_early)
        for plan, ends_early in ((default, False), (other, False), (other, True))
    )
    least_gained, most_gained = 1.0 if skipped is None else 1.0 / computed, 1.0 / computed

    def gained(units: Work, stage: str) -> list[float]:
        return [before.get(key, 0.0) / units[key] for key in units if key[0] == stage]

    return {OTHER: (least_gained, most_gained)} | {
        stage: (
            least_gained * min(gained(full, stage), default=math.inf),
            most_gained * max(gained(least, stage), default=math.inf),
        )
        for stage in other.stages
    }


def with_other(shares: Mapping[str, float]) -> dict[str, float]:
    """The `shares` of a frame by stage, and that of the frame itself."""
    return {**shares, OTHER: max(1.0 - math.fsum(shares.values()), 0.0)}


def widened(shares: Mapping[str, float], margin: float) -> StageRanges:
    """`shares` of a frame by stage, each from that over `margin` to that times `margin`."""
    return {stage: (share / margin, min(share * margin, 1.0)) for stage, share in shares.items()}


def work_range(ratios: StageRanges, shares: StageRanges) -> tuple[float, float]:
    """The possible log ratios (low, high) of a configuration: no confirmation lifts a session beyond them.

    `ratios`: how many times faster each stage may be. `shares`: how large a part of the default's frame it
    may be; 0 to 1 for a stage without one. At most 1 / sum(share / ratio): each stage has its smallest share,
    and the rest goes to the stages with the largest ratios. At least the smallest ratio, less
    LOG_WORK_MARGIN.
    """
    stages = sorted(ratios, key=lambda stage: -ratios[stage][1])
    ranges = [(shares.get(stage, (0.0, 1.0)), ratios[stage][1]) for stage in stages]
    rest = 1.0 - math.fsum(low for (low, _), _ in ranges)
    time = 0.0
    for (low, high), ratio in ranges:
        share = low + max(min(high - low, rest), 0.0)
        rest -= share - low
        time += share / ratio if ratio else 0.0
    least = min(low for low, _ in ratios.values())
    return (
        math.log(least) - LOG_WORK_MARGIN if least else -math.inf,
        -math.log(time) if time else math.inf,
    )


def _work_by_kernel(plan: Plan, numbers: Sequence[int], ends_early: bool) -> Work:
    """Units of each (stage, kernel), launches and steps among them.

    `ends_early`: only what has to be done.
    """
    units: dict[tuple[str, str], float] = defaultdict(float)
    for dispatch in plan.dispatches:
        share = _share(dispatch, numbers, fusing=not ends_early)
        if not share:
            continue
        units[dispatch.stage, LAUNCHES] += share
        if ends_early and dispatch.flag == ITERATING:
            continue
        items = share * _items(dispatch)
        units[dispatch.stage, dispatch.kernel] += items
        for step in dispatch.arguments.keys() & RAY_STEPS:
            units[dispatch.stage, step] += items / float(str(dispatch.arguments[step]))
    return dict(units)


def _share(dispatch: Dispatch, numbers: Sequence[int], fusing: bool) -> float:
    """The share of the frames `numbers` in which `dispatch` takes place.

    `fusing`: motion chooses every frame for fusing, else none.
    """
    chosen = [frames for frames in dispatch.frames if fusing and frames.after == FUSING]
    return sum(
        dispatch.takes_place(number) or any(replace(frames, after=None).hold(number) for frames in chosen)
        for number in numbers
    ) / len(numbers)


def _items(dispatch: Dispatch) -> float:
    """Work-items, or what they walk through: the voxels of a column, the pixels that are summed."""
    walked = [float(str(dispatch.arguments[name])) for name in WALKED.get(dispatch.kernel, ())]
    return math.prod(walked) if walked else float(math.prod(dispatch.size))
