"""The response surface of two parameters: time and trajectory error over a grid of their values.

Nardi et al. 2015 draw it for mu and icp_threshold. The grid may be measured in several rounds, which
`slam.reports.relief` takes apart into shape and noise. Measurements are kept in a CSV file, so that an
interrupted grid resumes where it stopped.
"""

from __future__ import annotations

import csv
import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam.benchmark import Report
from slam.configuration import ConfigurationError
from slam.devices.device import DeviceError
from slam.reports.page import escape, plotly
from wire.protocol import VALID_BELOW

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEASURED = ("runtime", "ate_mean", "ate_max", "lost", "failure")
ROUND = "round"  # the column of its number, from 1
LOG_SPAN = 20  # values that span more than this, all above zero, are drawn on a logarithmic axis


class SurfaceError(ValueError):
    """A grid that cannot be measured, or a file with other content."""


@dataclass(frozen=True)
class Grid:
    """Two parameters by name and the values of each, ascending.

    Raises SurfaceError when both are the same or one has fewer than two values.
    """

    x: str
    y: str
    x_values: tuple[float, ...]
    y_values: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.x == self.y:
            raise SurfaceError(f"x and y are both {self.x}: choose two parameters")
        for name, values in ((self.x, self.x_values), (self.y, self.y_values)):
            if len(set(values)) < 2:
                raise SurfaceError(f"{name} has {len(set(values))} value: a surface needs at least two")

    def points(self) -> Iterator[dict[str, float]]:
        """Every pair of values, row by row of y."""
        for y in self.y_values:
            for x in self.x_values:
                yield {self.x: x, self.y: y}


class Measurements:
    """The rows of a CSV file by their point: every column except MEASURED is part of it.

    A line that was cut off is dropped. Raises SurfaceError when the file has other content.
    """

    def __init__(self, path: Path, columns: Iterable[str]) -> None:
        self._path = path
        self._columns = tuple(columns)
        self._rows: dict[tuple[str, ...], dict[str, str]] = {}
        header = [*self._columns, *MEASURED]
        if path.exists():
            try:
                with path.open(newline="", encoding="utf-8") as file:
                    lines = list(csv.reader(file))
            except (UnicodeDecodeError, csv.Error) as error:
                raise SurfaceError(f"{path} is not a CSV file: {error}") from None
            if lines and lines[0] != header:
                raise SurfaceError(
                    f"{path} has other columns than a surface of this version: choose another folder"
                )
            for line in lines[1:]:
                if len(line) == len(header) and _is_complete(line[len(self._columns) :]):
                    row = dict(zip(header, line, strict=True))
                    self._rows[self._key(row)] = row
        # Written to a new file that replaces the old one: nothing is lost, and no cut line is continued.
        fresh = path.with_suffix(".new")
        with fresh.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, header)
            writer.writeheader()
            writer.writerows(self._rows.values())
        fresh.replace(path)

    def find(self, identity: Mapping[str, Any]) -> Mapping[str, str] | None:
        return self._rows.get(self._key(identity))

    def add(self, identity: Mapping[str, Any], measured: Mapping[str, Any]) -> None:
        row = {name: _text(value) for name, value in (dict(identity) | dict(measured)).items()}
        self._rows[self._key(row)] = row
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, [*self._columns, *MEASURED]).writerow(row)

    def _key(self, row: Mapping[str, Any]) -> tuple[str, ...]:
        return tuple(_text(row[name]) for name in self._columns)


def _text(value: Any) -> str:
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _is_complete(measured: Sequence[str]) -> bool:
    try:
        return bool(measured[-1]) or all(math.isfinite(float(value)) for value in measured[:-1])
    except ValueError:
        return False


def measure(
    grid: Grid,
    complete: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    run: Callable[[Mapping[str, Any]], Report],
    setting: Mapping[str, Any],
    path: Path,
    rounds: int = 1,
) -> dict[str, NDArray[np.float64]]:
    """Measure what `path` lacks; return "runtime", "ate_mean" and "ate_max" as (rounds, y, x) arrays.

    Every round measures each point once, in an order of its own: a machine that slows down meanwhile slows
    other points in the next round. `complete` fills in a configuration, `run` measures one, `setting` names
    everything else that a measurement depends on (sequence, frames, device ...). A configuration that this
    device cannot run is kept as a failure with its reason (remove its line to try again) and is NaN in the
    arrays; a bad parameter of any point raises ConfigurationError before anything is measured. A run without
    truth raises SurfaceError.
    """
    configurations = [complete(point) for point in grid.points()]
    measurements = Measurements(path, [*setting, ROUND, *configurations[0]])
    names = ("runtime", "ate_mean", "ate_max")
    measured = np.empty((len(names), rounds, len(configurations)))
    for number in range(rounds):
        order = list(range(len(configurations)))
        random.Random(number).shuffle(order)
        for point in order:
            identity = dict(setting) | {ROUND: number + 1} | dict(configurations[point])
            row = measurements.find(identity)
            if row is None:
                measurements.add(identity, _outcome(configurations[point], run))
                row = measurements.find(identity)
            assert row is not None
            measured[:, number, point] = [float(row[name] or "nan") for name in names]
    shape = (rounds, len(grid.y_values), len(grid.x_values))
    return {name: values.reshape(shape) for name, values in zip(names, measured, strict=True)}


def _outcome(configuration: Mapping[str, Any], run: Callable[[Mapping[str, Any]], Report]) -> dict[str, Any]:
    try:
        report = run(configuration)
    except (DeviceError, ConfigurationError) as error:
        return dict.fromkeys(MEASURED) | {"failure": " ".join(str(error).split())}
    if report.ate is None:
        raise SurfaceError("the sequence has no true trajectory, so there is no error to draw: give --truth")
    return {
        "runtime": report.runtime,
        "ate_mean": report.ate.mean,
        "ate_max": report.ate.max,
        "lost": sum(frame.tracked is False for frame in report.frames),
        "failure": "",
    }


def table(grid: Grid, measured: Mapping[str, NDArray[np.float64]]) -> str:
    """Both surfaces as text, means over the rounds."""
    lines = []
    for title, name, unit, form in (
        ("mean computation, wall milliseconds a frame", "runtime", 1e3, "12.3f"),
        (f"max trajectory error, centimetres (valid below {100 * VALID_BELOW:g})", "ate_max", 1e2, "12.2f"),
    ):
        lines += [f"{title}; one row for each {grid.y}, one column for each {grid.x}", " " * 10]
        lines[-1] += "".join(f"{value:12g}" for value in grid.x_values)
        for value, row in zip(grid.y_values, measured[name].mean(axis=0), strict=True):
            cells = (f"{unit * cell:{form}}" if np.isfinite(cell) else f"{'failed':>12}" for cell in row)
            lines.append(f"{value:<10g}" + "".join(cells))
        lines.append("")
    return "\n".join(lines)


def figures(grid: Grid, measured: Mapping[str, NDArray[np.float64]], title: str) -> list[Figure]:
    """The response surfaces of time and of error, means over the rounds, the latter with the plane below
    which runs are valid.

    Raises MissingPlotlyError.
    """
    go = plotly()
    drawn = []
    for what, values, z_title, colours in (
        ("computation", 1e3 * measured["runtime"].mean(axis=0), "wall milliseconds a frame", "Viridis"),
        ("max trajectory error", measured["ate_max"].mean(axis=0), "metres", "Cividis"),
    ):
        figure = go.Figure(_surface(grid, values, z_title, colours))
        if what != "computation":
            figure.add_surface(
                x=grid.x_values, y=grid.y_values, z=np.full(values.shape, VALID_BELOW), opacity=0.4,
                showscale=False, colorscale=[[0, "#888888"], [1, "#888888"]],
                hovertemplate=f"valid below {VALID_BELOW} m<extra></extra>",
            )  # fmt: skip
        figure.update_layout(
            title=escape(f"Response surface of {what}: {title}"),
            scene={
                "xaxis": {"title": grid.x, **_axis(grid.x_values, grid.x_values)},
                "yaxis": {"title": grid.y, **_axis(grid.y_values, grid.y_values)},
                "zaxis": {"title": z_title, **_axis(values, _round_values(values))},
                "aspectmode": "cube",
            },
            height=750,
            template="plotly_white",
        )
        drawn.append(figure)
    return drawn


def _surface(grid: Grid, values: NDArray[np.float64], z_title: str, colours: str) -> Any:
    # Colours follow the axis: where an error spans decades, the small values matter.
    colour = np.log10(values) if is_log(values) else values
    ticks = np.array(_round_values(values))
    return plotly().Surface(
        x=grid.x_values,
        y=grid.y_values,
        z=[[float(cell) if np.isfinite(cell) else None for cell in row] for row in values],
        surfacecolor=colour,
        colorscale=colours,
        colorbar={
            "title": z_title,
            "tickvals": np.log10(ticks) if is_log(values) else ticks,
            "ticktext": [f"{tick:g}" for tick in ticks],
        },
        hovertemplate=f"{grid.x} %{{x}}<br>{grid.y} %{{y}}<br>%{{z}} {z_title}<extra></extra>",
    )


def _axis(values: Sequence[float] | NDArray[np.float64], ticks: Sequence[float]) -> dict[str, Any]:
    """The best scale for these values, with its ticks."""
    text = [f"{tick:g}" for tick in ticks]
    return {"type": "log" if is_log(values) else "linear", "tickvals": list(ticks), "ticktext": text}


def is_log(values: Sequence[float] | NDArray[np.float64]) -> bool:
    finite = np.array(values, np.float64)
    finite = finite[np.isfinite(finite)]
    return bool(len(finite) and finite.min() > 0 and finite.max() / finite.min() > LOG_SPAN)


def _round_values(values: NDArray[np.float64]) -> list[float]:
    """Round numbers over the range of the values: 1, 2 and 5 times powers of ten, or some five steps."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return []
    low, high = float(finite.min()), float(finite.max())
    if is_log(values):
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        steps = [f * 10.0**decade for decade in decades for f in (1, 2, 5)]
        return [step for step in steps if low / 2 <= step <= 2 * high]
    rough = (high - low or abs(high) or 1.0) / 4
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(f * power for f in (1, 2, 5, 10) if f * power >= rough)
    return [step * number for number in range(math.floor(low / step), math.ceil(high / step) + 1)]
