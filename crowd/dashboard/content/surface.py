"""The shipped response surfaces: time and trajectory error over a grid of two parameters.

`python -m slam surface` wrote the CSV files; the JSON beside each describes its measurement.
"""

import csv
import json
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd.explorations.searching.baseline_configurations import DEFAULT_OF_THE_APP
from crowd.fronts.selectors import DEFAULT_APPLICATION
from groundwork.folders import FIXTURES
from slam.definitions import complete, definition
from slam.reports.relief import Relief
from slam.reports.surface import MEASURED, ROUND, Grid
from wire.protocol import VALID_BELOW

# Columns of the setting. Columns that are neither these, MEASURED nor an axis belong to the configuration.
SETTING = ("system", "sequence", "frames", "volume_size", "initial_position", "device", ROUND)


@dataclass(frozen=True)
class Surface:
    """Runtimes (s) and maximum trajectory errors (m), each (rounds, y, x); NaN if a run was impossible.

    `alike` groups rows of y with exactly equal trajectories. The device did the same work there, so their
    times differ only by noise.
    """

    application: str
    x: str
    y: str
    x_values: tuple[float, ...]
    y_values: tuple[float, ...]
    runtimes: NDArray[np.float64]
    errors: NDArray[np.float64]
    alike: tuple[tuple[int, ...], ...]
    fixed: dict[str, str]
    frames: int
    provenance: dict[str, Any]

    @property
    def runtime(self) -> NDArray[np.float64]:
        """The mean runtime of each cell, (y, x)."""
        return _mean(self.runtimes)

    @property
    def ate_max(self) -> NDArray[np.float64]:
        """The mean over the rounds of each cell's maximum trajectory error, (y, x)."""
        return _mean(self.errors)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether all trajectories of each cell are within the limit, (y, x)."""
        valid: NDArray[np.bool_] = np.all(self.errors < VALID_BELOW, axis=0)
        return valid

    @property
    def unusual(self) -> dict[str, Any]:
        """The fixed parameters that do not have the default configuration's value, with that value."""
        published = definition(self.application).known.get(DEFAULT_OF_THE_APP, {})
        usual = complete(self.application, published)
        return {name: usual[name] for name, value in self.fixed.items() if str(usual[name]) != value}

    @property
    def rounds(self) -> int:
        return len(self.runtimes)

    @property
    def repeats(self) -> str:
        """How often each cell was measured, in words."""
        return "once" if self.rounds == 1 else f"{self.rounds} times"


@dataclass(frozen=True)
class Cell:
    """A cell: its two values, seconds per frame and the maximum trajectory error in metres."""

    x: float
    y: float
    runtime: float
    ate_max: float


class Repeated(NamedTuple):
    """The mean of a cell over the rounds, and its standard deviation: None for NaN and for one round."""

    mean: float | None
    deviation: float | None


@dataclass(frozen=True)
class Row:
    """A row of the table: a value of y; seconds and metres for each value of x."""

    y: float
    runtime: tuple["Repeated", ...]
    ate_max: tuple["Repeated", ...]


@dataclass(frozen=True)
class SurfaceSummary:
    """Statistics of a surface.

    The `..._across` and `..._along` are the largest ratios of the maximum to the minimum of a row and of a
    column. `noise`: such ratios for times of equal work, the median over columns and the maximum. `relief`:
    the noise of a single time, apart from the shape of the surface; None with one round.
    """

    cells: int
    valid: int
    fastest: Cell | None
    most_accurate: Cell | None
    inside: bool  # the most accurate cell is not at an end of x
    runtime_across: float
    runtime_along: float
    ate_across: float
    ate_along: float
    noise: tuple[float, float] | None
    relief: Relief | None


@cache
def shipped() -> dict[str, Surface]:
    """The surfaces in fixtures/surfaces by application, the default one first."""
    files = sorted((FIXTURES / "surfaces").glob("*.json"))
    surfaces = sorted(map(read, files), key=lambda surface: surface.application != DEFAULT_APPLICATION)
    return {surface.application: surface for surface in surfaces}


def chosen(application: str) -> Surface | None:
    """The surface of `application`, "" for the first, or None."""
    surfaces = shipped()
    return surfaces.get(application) if application else next(iter(surfaces.values()), None)


def read(description: Path) -> Surface:
    """Read the surface in `description` (JSON: x, y, provenance) and the CSV file beside it.

    Each cell may be measured in several rounds. Raises ValueError if a round of the grid is incomplete, or if
    settings or configurations are mixed.
    """
    description_json = json.loads(description.read_text(encoding="utf-8"))
    with description.with_suffix(".csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    x, y = description_json["x"], description_json["y"]
    constant = [name for name in rows[0] if name not in {x, y, ROUND, *MEASURED}]
    if any(row[name] != rows[0][name] for row in rows for name in constant):
        raise ValueError(f"{description.stem}: its rows were measured in more than one setting")
    cells = {(int(row.get(ROUND, 1)), float(row[y]), float(row[x])): row for row in rows}
    rounds = sorted({number for number, _, _ in cells})
    y_values, x_values = (sorted({key[axis] for key in cells}) for axis in (1, 2))
    for number in rounds:
        measured = sum(key[0] == number for key in cells)
        if measured != len(x_values) * len(y_values):
            raise ValueError(
                f"{description.stem}: the {measured} cells of round {number} are not a full grid of "
                f"{len(x_values)} x {len(y_values)}: measure the others, or remove the round's lines"
            )

    def grid(name: str) -> NDArray[np.float64]:
        keys = product(rounds, y_values, x_values)
        values = [float(cells[key][name] or "nan") for key in keys]
        return np.reshape(values, (len(rounds), len(y_values), len(x_values)))

    return Surface(
        application=rows[0]["system"],
        x=x,
        y=y,
        x_values=tuple(x_values),
        y_values=tuple(y_values),
        runtimes=grid("runtime"),
        errors=grid("ate_max"),
        alike=_alike(np.stack([grid("ate_max"), grid("ate_mean")], axis=-1)),
        fixed={name: rows[0][name] for name in constant if name not in SETTING},
        frames=int(rows[0]["frames"]),
        provenance=description_json["provenance"],
    )


def summarise(surface: Surface) -> SurfaceSummary:
    """The statistics of `surface`."""
    valid = surface.valid
    accurate = _cell(surface, surface.ate_max, np.isfinite(surface.ate_max))
    return SurfaceSummary(
        cells=surface.runtime.size,
        valid=int(valid.sum()),
        fastest=_cell(surface, surface.runtime, valid),
        most_accurate=accurate,
        inside=accurate is not None and accurate.x not in (surface.x_values[0], surface.x_values[-1]),
        runtime_across=_span(surface.runtime, axis=1),
        runtime_along=_span(surface.runtime, axis=0),
        ate_across=_span(surface.ate_max, axis=1),
        ate_along=_span(surface.ate_max, axis=0),
        noise=_noise(surface),
        relief=_relief(surface),
    )


def rows(surface: Surface) -> tuple[Row, ...]:
    """`surface` as rows of a table."""
    return tuple(
        Row(y, tuple(runtimes), tuple(errors))
        for y, runtimes, errors in zip(
            surface.y_values, repeated(surface.runtimes), repeated(surface.errors), strict=True
        )
    )


def repeated(values: NDArray[np.float64]) -> list[list[Repeated]]:
    """Mean and standard deviation of `values` (rounds, y, x) over the rounds, by row and column."""
    means = _mean(values)
    spread = values.std(axis=0, ddof=1) if len(values) > 1 else np.full_like(means, np.nan)
    return [
        [Repeated(_known(mean), _known(deviation)) for mean, deviation in zip(*pair, strict=True)]
        for pair in zip(means, spread, strict=True)
    ]


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    means: NDArray[np.float64] = values.mean(axis=0)
    return means


def _known(value: np.float64) -> float | None:
    return float(value) if np.isfinite(value) else None


def _relief(surface: Surface) -> Relief | None:
    if surface.rounds == 1:
        return None
    grid = Grid(surface.x, surface.y, surface.x_values, surface.y_values)
    return Relief.of(grid, surface.runtimes)


def _alike(errors: NDArray[np.float64]) -> tuple[tuple[int, ...], ...]:
    """Groups of two or more equal rows of `errors` (rounds, y, x, errors), by their indices."""
    groups: dict[bytes, list[int]] = {}
    for number, row in enumerate(np.moveaxis(errors, 1, 0)):
        groups.setdefault(row.tobytes(), []).append(number)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def _cell(surface: Surface, values: NDArray[np.float64], among: NDArray[np.bool_]) -> Cell | None:
    """The cell with the smallest of `values`, restricted to `among`; the first of equal ones."""
    if not among.any():
        return None
    row, column = np.unravel_index(np.argmin(np.where(among, values, np.inf)), values.shape)
    return Cell(
        surface.x_values[column],
        surface.y_values[row],
        float(surface.runtime[row, column]),
        float(surface.ate_max[row, column]),
    )


def _span(values: NDArray[np.float64], axis: int) -> float:
    return float(np.nanmax(np.nanmax(values, axis=axis) / np.nanmin(values, axis=axis)))


def _noise(surface: Surface) -> tuple[float, float] | None:
    ratios = [
        surface.runtime[list(group)].max(axis=0) / surface.runtime[list(group)].min(axis=0)
        for group in surface.alike
    ]
    if not ratios:
        return None
    together = np.concatenate(ratios)
    return (
        (float(np.nanmedian(together)), float(np.nanmax(together))) if np.isfinite(together).any() else None
    )
