"""Side by side: devices, or configurations of a front on one device, each by its newest figures."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from crowd.dashboard.content.points import newest_figure
from crowd.dashboard.content.ranking import standing
from crowd.dashboard.content.stages import StageTimes, times_of
from crowd.fronts.selectors import BEST, DEFAULT, Front
from crowd.results.reading.rows import Device, DeviceDetail, Speedup

LEAST, MOST = 2, 6


class InvalidComparisonError(ValueError):
    """What cannot stand side by side; the message names it and says what would be right."""


@dataclass(frozen=True)
class Compared:
    """One device: its speedup (None before any), seconds a frame of default and best, and their stages."""

    device: Device
    figure: Speedup | None
    default: float | None
    best: float | None
    stages: tuple[StageTimes, ...]


@dataclass(frozen=True)
class Configured:
    """One configuration on a device: its figure (None: no valid one, or the default), its times in the
    newest session (None where that has none), and its parameters.
    """

    name: str
    figure: Speedup | None
    times: StageTimes | None
    parameters: Mapping[str, Any]


@dataclass(frozen=True)
class Comparison:
    """Either devices, or configurations on `device`; `bars` is what one chart of stages shows. `application`
    is one of the `applications` that all of them were measured with.
    """

    devices: tuple[Compared, ...]
    device: Device | None
    front: str
    configurations: tuple[Configured, ...]
    bars: tuple[StageTimes, ...]
    application: str = ""
    applications: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters in which the configurations differ."""
        names = dict.fromkeys(name for column in self.configurations for name in column.parameters)
        return tuple(
            name
            for name in names
            if len({repr(column.parameters.get(name)) for column in self.configurations}) > 1
        )

    @property
    def query(self) -> str:
        """The shortest query string that asks for it."""
        return self.with_application(self.application if len(self.applications) > 1 else "")

    def with_application(self, name: str) -> str:
        """The query string that asks for the same with the application NAME; "" names none."""
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
        """The devices' figures, where all have one of the same front."""
        found = tuple(column.figure for column in self.devices if column.figure)
        alike = len(found) == len(self.devices) and len({figure.front for figure in found}) == 1
        return found if alike else ()

    @property
    def unconfirmed(self) -> bool:
        """Whether a figure in it is unconfirmed."""
        figures = [column.figure for column in self.devices]
        figures += [column.figure for column in self.configurations]
        return any(not figure.confirmed for figure in figures if figure and not figure.suspect)

    @property
    def simulated(self) -> bool:
        """Whether nobody measured what is shown."""
        shown = [column.device for column in self.devices] + ([self.device] if self.device else [])
        return any(device.simulated for device in shown)


def parse_names(values: Iterable[str], noun: str, most: int = MOST) -> tuple[str, ...]:
    """Names out of ?devices=a,b or ?devices=a&devices=b, each once, MOST at most. NOUN is what they are names
    of.

    Raises InvalidComparisonError.
    """
    names = tuple(dict.fromkeys(name for value in values for name in value.split(",") if name))
    if not LEAST <= len(names) <= most:
        named = ", ".join(names) or "none"
        count = f"{LEAST} to {most}" if most > LEAST else f"{LEAST}"
        raise InvalidComparisonError(f"name {count} {noun} to compare, not {named:.300}")
    return names


def of_devices(details: Sequence[DeviceDetail]) -> Comparison:
    """DETAILS, of one application, side by side. Raises InvalidComparisonError for simulated devices beside
    measured ones.
    """
    if len({detail.device.simulated for detail in details}) > 1:
        raise InvalidComparisonError("simulated devices stand beside simulated ones alone: choose one kind")
    columns = tuple(_compared(detail) for detail in details)
    return Comparison(columns, None, "", (), _labelled(columns))


def of_configurations(detail: DeviceDetail, front: Front, names: Sequence[str]) -> Comparison:
    """The configurations NAMES of FRONT on one device. Raises InvalidComparisonError for one it lacks."""
    for name in names:
        if front.point(name) is None:
            there = ", ".join(point.name for point in front.points)
            raise InvalidComparisonError(f"front {front.slug} has no configuration {name:.100}, but {there}")
    place = standing(detail, newest_figure(detail))
    figures = {row.configuration: row for row in place.rows} if place else {}
    latest = detail.latest if detail.latest and detail.latest.session.front == front.slug else None
    times = {row.configuration: row for row in times_of(latest)}
    points = {point.name: point for point in front.points}
    columns = tuple(
        Configured(name, figures.get(name), times.get(name), points[name].parameters) for name in names
    )
    bars = tuple(column.times for column in columns if column.times is not None)
    return Comparison((), detail.device, front.slug, columns, bars)


def _compared(detail: DeviceDetail) -> Compared:
    """DETAIL as one column; times are means over the runs of its newest session."""
    stages = times_of(detail.latest)
    times = {row.configuration: row.computation for row in stages}
    return Compared(detail.device, newest_figure(detail), times.get(DEFAULT), times.get(BEST), stages)


def _labelled(columns: Sequence[Compared]) -> tuple[StageTimes, ...]:
    """Every column's default and best, named after its device, for one chart."""
    return tuple(
        StageTimes(f"{row.configuration}, {column.device.title}", row.runs, row.seconds, row.computation)
        for column in columns
        for row in column.stages
        if row.configuration in {DEFAULT, BEST}
    )
