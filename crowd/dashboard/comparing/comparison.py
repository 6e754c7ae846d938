"""Comparisons of devices, or of configurations of a front on one device, by their newest figures."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.content.ranking import rank_configurations
from crowd.dashboard.content.stages import StageTimes, times_of
from crowd.records.device import Device
from crowd.records.speedup import Speedup
from crowd.results.reading.rows import DeviceDetail
from wire.front import BEST, DEFAULT, Front

LEAST, MOST = 2, 6


class InvalidComparisonError(ValueError):
    """These cannot be compared; the message gives the reason and the remedy."""


@dataclass(frozen=True)
class DeviceColumn:
    """A device: its speedup (None without one), seconds per frame of default and best, and their stages."""

    device: Device
    figure: Speedup | None
    default: float | None
    best: float | None
    stages: tuple[StageTimes, ...]


@dataclass(frozen=True)
class ConfigurationColumn:
    """A configuration on a device.

    `figure` is None for the default, and without a valid figure. `times` are those of the newest session, or
    None.
    """

    name: str
    figure: Speedup | None
    times: StageTimes | None
    parameters: Mapping[str, Any]


@dataclass(frozen=True)
class Comparison:
    """A comparison of devices, or of configurations on `device`. `bars` are the rows of the chart of stages.

    `application` is one of the `applications` that all devices were measured with.
    """

    devices: tuple[DeviceColumn, ...]
    device: Device | None
    front: str
    configurations: tuple[ConfigurationColumn, ...]
    bars: tuple[StageTimes, ...]
    application: str = ""
    applications: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the parameters that differ between the configurations."""
        names = dict.fromkeys(name for column in self.configurations for name in column.parameters)
        return tuple(
            name
            for name in names
            if len({repr(column.parameters.get(name)) for column in self.configurations}) > 1
        )

    @property
    def query(self) -> str:
        """The shortest query string for this comparison."""
        return self.with_application(self.application if len(self.applications) > 1 else "")

    def with_application(self, name: str) -> str:
        """The query string for this comparison with the application `name`; "" leaves it out."""
        if self.device is None:
            asked = {"devices": ",".join(column.device.slug for column in self.devices)}
        else:
            names = ",".join(column.name for column in self.configurations)
            asked = {"configurations": names, "device": self.device.slug}
        if name:
            asked["application"] = name
        return urlencode(asked, safe=",")

    @property
    def figures(self) -> tuple[Speedup, ...]:
        """The figures of the devices if all have one of the same front, otherwise none."""
        figures = tuple(column.figure for column in self.devices if column.figure)
        alike = len(figures) == len(self.devices) and len({figure.front for figure in figures}) == 1
        return figures if alike else ()

    @property
    def unconfirmed(self) -> bool:
        """Whether one of the figures is unconfirmed."""
        figures = [column.figure for column in self.devices]
        figures += [column.figure for column in self.configurations]
        return any(not figure.confirmed for figure in figures if figure and not figure.suspect)


def parse_names(values: Iterable[str], noun: str, most: int = MOST) -> tuple[str, ...]:
    """The distinct names of ?devices=a,b or ?devices=a&devices=b, at most `most`. `noun` says what they name.

    Raises InvalidComparisonError.
    """
    names = tuple(dict.fromkeys(name for value in values for name in value.split(",") if name))
    if not LEAST <= len(names) <= most:
        named = ", ".join(names) or "none"
        count = f"{LEAST} to {most}" if most > LEAST else f"{LEAST}"
        raise InvalidComparisonError(f"name {count} {noun} to compare, not {named:.300}")
    return names


def compare_devices(details: Sequence[DeviceDetail]) -> Comparison:
    """Compare devices of one application."""
    columns = tuple(_device_column(detail) for detail in details)
    return Comparison(columns, None, "", (), _labelled(columns))


def compare_configurations(detail: DeviceDetail, front: Front, names: Sequence[str]) -> Comparison:
    """Compare the configurations `names` of `front` on a device.

    Raises InvalidComparisonError for unknown ones.
    """
    for name in names:
        if front.point(name) is None:
            choices = ", ".join(point.name for point in front.points)
            raise InvalidComparisonError(
                f"front {front.slug} has no configuration {name:.100}: choose from {choices}"
            )
    ranked = rank_configurations(detail, newest_figure(detail))
    figures = {row.configuration: row for row in ranked.rows} if ranked else {}
    latest = detail.latest if detail.latest and detail.latest.session.front == front.slug else None
    times = {row.configuration: row for row in times_of(latest)}
    points = {point.name: point for point in front.points}
    columns = tuple(
        ConfigurationColumn(name, figures.get(name), times.get(name), points[name].parameters)
        for name in names
    )
    bars = tuple(column.times for column in columns if column.times is not None)
    return Comparison((), detail.device, front.slug, columns, bars)


def _device_column(detail: DeviceDetail) -> DeviceColumn:
    """The column of a device; times are means over the runs of its newest session."""
    stages = times_of(detail.latest)
    times = {row.configuration: row.computation for row in stages}
    return DeviceColumn(detail.device, newest_figure(detail), times.get(DEFAULT), times.get(BEST), stages)


def _labelled(columns: Sequence[DeviceColumn]) -> tuple[StageTimes, ...]:
    """The stage times of default and best on each device, named after the device."""
    return tuple(
        StageTimes(f"{row.configuration}, {column.device.title}", row.runs, row.seconds, row.computation)
        for column in columns
        for row in column.stages
        if row.configuration in {DEFAULT, BEST}
    )
