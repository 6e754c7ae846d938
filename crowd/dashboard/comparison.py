"""Devices side by side, each by its newest figure and its newest session."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from crowd.dashboard.points import newest_figure
from crowd.dashboard.protocols import first_counted_frame
from crowd.dashboard.stages import StageTimes, stage_times
from crowd.fronts.selectors import BEST, DEFAULT
from crowd.results.rows import Device, DeviceDetail, Speedup

LEAST, MOST = 2, 6


class InvalidComparisonError(ValueError):
    """Too few or too many devices; the message names them and says what would be right."""


@dataclass(frozen=True)
class Compared:
    """One device: its speedup (None before any), seconds a frame of default and best, and their stages."""

    device: Device
    figure: Speedup | None
    default: float | None
    best: float | None
    stages: tuple[StageTimes, ...]


def parse_devices(values: Iterable[str]) -> tuple[str, ...]:
    """Slugs out of ?devices=a,b or ?devices=a&devices=b, each once. Raises InvalidComparisonError."""
    slugs = tuple(dict.fromkeys(slug for value in values for slug in value.split(",") if slug))
    if not LEAST <= len(slugs) <= MOST:
        named = ", ".join(slugs) or "none"
        raise InvalidComparisonError(f"name {LEAST} to {MOST} devices to compare, not {named}")
    return slugs


def compared(detail: DeviceDetail) -> Compared:
    """DETAIL as one column; times are means over the runs of its newest session."""
    latest = detail.latest
    stages = stage_times(latest.runs, first_counted_frame(latest.protocol)) if latest else ()
    times = {row.configuration: row.computation for row in stages}
    return Compared(detail.device, newest_figure(detail), times.get(DEFAULT), times.get(BEST), stages)


def labelled(columns: Sequence[Compared]) -> tuple[StageTimes, ...]:
    """Every column's default and best, named after its device, for one chart."""
    return tuple(
        StageTimes(f"{row.configuration}, {column.device.title}", row.runs, row.seconds, row.computation)
        for column in columns
        for row in column.stages
        if row.configuration in {DEFAULT, BEST}
    )
