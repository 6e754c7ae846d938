"""The shipped response surfaces: time and trajectory error over a grid of two parameters.

`python -m slam surface` wrote the CSV files; the JSON beside each describes its measurement.
"""

import csv
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd.fronts.selectors import DEFAULT_APPLICATION
from frontrunner.folders import FIXTURES
from slam.protocol import VALID_BELOW
from slam.reports.surface import MEASURED, ROUND

# Columns of the setting. Columns that are neither these, MEASURED nor an axis belong to the configuration.
SETTING = ("system", "sequence", "frames", "volume_size", "initial_position", "device", ROUND)


@dataclass(frozen=True)
class Surface:
    """Runtime (s) and maximum trajectory error (m), each (y, x); NaN if the device could not run it.

    `alike` groups rows of y with exactly equal trajectories. The device did the same work there, so their
    times differ only by noise.
    """

    application: str
    x: str
    y: str
    x_values: tuple[float, ...]
    y_values: tuple[float, ...]
    runtime: NDArray[np.float64]
    ate_max: NDArray[np.float64]
    alike: tuple[tuple[int, ...], ...]
    fixed: dict[str, str]
    frames: int
    provenance: dict[str, Any]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether the trajectory of each cell is within the limit, (y, x)."""
        return self.ate_max < VALID_BELOW


@dataclass(frozen=True)
class Cell:
    """A cell: its two values, seconds per frame and the maximum trajectory error in metres."""

    x: float
    y: float
    runtime: float
    ate_max: float


@dataclass(frozen=True)
class Row:
    """A row of the table: a value of y; seconds and metres for each value of x, None for NaN."""

    y: float
    runtime: tuple[float | None, ...]
    ate_max: tuple[float | None, ...]


@dataclass(frozen=True)
class SurfaceSummary:
    """Statistics of a surface.

    The `..._across` and `..._along` are the largest ratios of the maximum to the minimum of a row and of a
    column. `noise`: such ratios for times of equal work, the median over columns and the maximum.
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

    Raises ValueError if the grid is incomplete, or if settings or configurations are mixed.
    """
    description_json = json.loads(description.read_text(encoding="utf-8"))
    with description.with_suffix(".csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    x, y = description_json["x"], description_json["y"]
    constant = [name for name in rows[0] if name not in {x, y, *MEASURED}]
    if any(row[name] != rows[0][name] for row in rows for name in constant):
        raise ValueError(f"{description.stem}: its rows were measured in more than one setting")
    cells = {(float(row[y]), float(row[x])): row for row in rows}
    y_values, x_values = (tuple(sorted({key[axis] for key in cells})) for axis in (0, 1))
    if len(cells) != len(x_values) * len(y_values):
        raise ValueError(
            f"{description.stem}: {len(cells)} cells are not a full grid of {len(x_values)} x {len(y_values)}"
        )

    def grid(name: str) -> NDArray[np.float64]:
        return np.array([[float(cells[v, u][name] or "nan") for u in x_values] for v in y_values])

    return Surface(
        application=rows[0]["system"],
        x=x,
        y=y,
        x_values=x_values,
        y_values=y_values,
        runtime=grid("runtime"),
        ate_max=grid("ate_max"),
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
    )


def rows(surface: Surface) -> tuple[Row, ...]:
    """`surface` as rows of a table."""
    return tuple(
        Row(y, _cells(surface.runtime[number]), _cells(surface.ate_max[number]))
        for number, y in enumerate(surface.y_values)
    )


def _cells(values: NDArray[np.float64]) -> tuple[float | None, ...]:
    return tuple(float(value) if np.isfinite(value) else None for value in values)


def _alike(errors: NDArray[np.float64]) -> tuple[tuple[int, ...], ...]:
    """Groups of two or more equal rows of `errors` (y, x, errors), by their indices."""
    groups: dict[bytes, list[int]] = {}
    for number, row in enumerate(errors):
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
