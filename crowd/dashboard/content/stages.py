"""Times of the stages of configurations and runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from crowd.results.reading.rows import RunSeries, SessionDetail
from crowd.results.validity.measures import OUTSIDE_COMPUTATION
from wire.front import BEST, DEFAULT

# Stages in pipeline order; other stages follow in alphabetical order.
ORDER = ("acquisition", "preprocessing", "tracking", "integration", "raycasting")


@dataclass(frozen=True)
class StageTimes:
    """Mean seconds per counted frame of each stage of a configuration, over `runs` runs."""

    configuration: str
    runs: int
    seconds: dict[str, float]
    computation: float


def ordered(names: Sequence[str] | set[str]) -> list[str]:
    """`names` of stages in pipeline order."""
    in_order = [stage for stage in ORDER if stage in names]
    return in_order + sorted(set(names) - set(ORDER))


def inside_computation(series: RunSeries) -> dict[str, NDArray[np.float64]]:
    """The stages within the computation of a run, in pipeline order: name -> seconds (n,)."""
    inside = {name for name in series.stage_seconds if name not in OUTSIDE_COMPUTATION}
    return {name: series.stage_seconds[name] for name in ordered(inside)}


def stage_times(runs: Sequence[RunSeries], first_counted: int) -> tuple[StageTimes, ...]:
    """A row per configuration, in order of first appearance, over its finished runs that have stages.

    Only stages within the computation count, over the frames from `first_counted` on.
    """
    by_configuration: dict[str, list[RunSeries]] = {}
    for series in runs:
        if series.run.finished and series.stage_seconds and len(series.frame_seconds) > first_counted:
            by_configuration.setdefault(series.run.configuration, []).append(series)
    return tuple(_mean_stages(name, members, first_counted) for name, members in by_configuration.items())


def times_of(session: SessionDetail | None) -> tuple[StageTimes, ...]:
    """The rows of `session` by its protocol; none without a session."""
    return () if session is None else stage_times(session.runs, session.protocol.first_counted_frame)


@dataclass(frozen=True)
class StageRow:
    """A stage across configurations: mean seconds per frame of each, None if it lacks the stage.

    `speedup`: default over best; None if one of them is missing or 0.
    """

    stage: str
    seconds: tuple[float | None, ...]
    speedup: float | None


@dataclass(frozen=True)
class StageTable:
    """Stages as rows, configurations as columns. `compared`: default and best are among them."""

    configurations: tuple[str, ...]
    rows: tuple[StageRow, ...]
    total: StageRow
    compared: bool

    @property
    def transposed(self) -> tuple[tuple[str, tuple[float | None, ...]], ...]:
        """Configurations as rows: the seconds of each stage, and last their total."""
        columns = zip(*(row.seconds for row in (*self.rows, self.total)), strict=True)
        return tuple(zip(self.configurations, columns, strict=True))


def stage_table(times: Sequence[StageTimes]) -> StageTable:
    """`times` as a table with a row per stage."""
    names = tuple(row.configuration for row in times)
    compared = DEFAULT in names and BEST in names

    def row(stage: str, seconds: Sequence[float | None]) -> StageRow:
        default, best = (
            (seconds[names.index(DEFAULT)], seconds[names.index(BEST)]) if compared else (None, None)
        )
        return StageRow(stage, tuple(seconds), default / best if default and best else None)

    stages = ordered({stage for each in times for stage in each.seconds})
    return StageTable(
        configurations=names,
        rows=tuple(row(stage, [each.seconds.get(stage) for each in times]) for stage in stages),
        total=row("computation", [each.computation for each in times]),
        compared=compared,
    )


@dataclass(frozen=True)
class StageSpread:
    """A stage of a run over the counted frames: mean and extremes in seconds, share of the total."""

    stage: str
    mean: float
    least: float
    most: float
    share: float


@dataclass(frozen=True)
class Frame:
    """A frame of a run: seconds of its computation and of each stage. `tracked` is None if not reported."""

    number: int
    counted: bool
    seconds: float
    stages: tuple[float, ...]
    tracked: bool | None


def spread(series: RunSeries, first_counted: int) -> tuple[StageSpread, ...]:
    """The stages of a run in pipeline order; none if it failed early or reported no stages."""
    counted = slice(first_counted, None)
    computation = float(series.frame_seconds[counted].sum())
    if not computation:
        return ()
    return tuple(
        StageSpread(
            stage=name,
            mean=float(seconds[counted].mean()),
            least=float(seconds[counted].min()),
            most=float(seconds[counted].max()),
            share=float(seconds[counted].sum()) / computation,
        )
        for name, seconds in inside_computation(series).items()
    )


def frames(series: RunSeries, first_counted: int) -> tuple[Frame, ...]:
    """All frames of a run with their stages in the order of `inside_computation`."""
    stages = list(inside_computation(series).values())
    return tuple(
        Frame(
            number=number,
            counted=number >= first_counted,
            seconds=float(seconds),
            stages=tuple(float(times[number]) for times in stages),
            tracked=series.tracked[number] if number < len(series.tracked) else None,
        )
        for number, seconds in enumerate(series.frame_seconds)
    )


@dataclass(frozen=True)
class Tracking:
    """Tracking in a run: of `frames`, it was attempted on `tried`, and failed on `lost` of these.

    `every`: from frame `first` on, every frame (1), every second one (2) and so on is tracked; None without
    such a rule.
    """

    frames: int
    tried: int
    lost: int
    first: int
    every: int | None


def tracking(series: RunSeries) -> Tracking | None:
    """Tracking in `series`; None if not reported."""
    numbers = [number for number, tracked in enumerate(series.tracked) if tracked is not None]
    if not numbers:
        return None
    steps = {later - earlier for earlier, later in pairwise(numbers)}
    return Tracking(
        frames=len(series.frame_seconds),
        tried=len(numbers),
        lost=series.tracked.count(False),
        first=numbers[0],
        every=steps.pop() if len(steps) == 1 else None,
    )


def _mean_stages(configuration: str, runs: Sequence[RunSeries], first_counted: int) -> StageTimes:
    counted = slice(first_counted, None)
    means: dict[str, list[float]] = {}
    for series in runs:
        for name, seconds in inside_computation(series).items():
            means.setdefault(name, []).append(float(seconds[counted].mean()))
    return StageTimes(
        configuration=configuration,
        runs=len(runs),
        seconds={name: float(np.mean(means[name])) for name in ordered(set(means))},
        computation=float(np.mean([series.frame_seconds[counted].mean() for series in runs])),
    )
