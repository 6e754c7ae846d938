"""python -m pareto compare: how similar devices are, from configurations measured on both."""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.cli.arguments import add_feasible, read_feasible, read_space, required_objectives
from pareto.devices.correlation import MINIMUM, Correlation, Estimate, correlate, ranks_of_best
from pareto.errors import ScenarioError
from pareto.fronts.censored import censored_names
from pareto.fronts.objective import Objective
from pareto.measuring.measurements import Measurement, read_measurements
from pareto.spaces.space import Space


def add_arguments(compare: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    compare.add_argument("tables", type=Path, nargs="+", metavar="CSV", help="one file a device")
    compare.add_argument(
        "--space", type=Path, required=True, help="a space, or a HyperMapper scenario, as JSON"
    )
    compare.add_argument("--objectives", help="names, separated by commas; a scenario brings its own")
    compare.add_argument("--maximise", default="", help="those of the objectives that are maximised")
    add_feasible(compare)
    compare.add_argument("--log", action="store_true", help="Pearson of logarithms, which suits times")
    compare.add_argument("--json", action="store_true", help="print JSON instead of a table")
    compare.set_defaults(act=compare_devices)


def compare_devices(options: argparse.Namespace) -> int:
    """Print the correlations of every two devices, and the rank of one's best on the other."""
    space, scenario = read_space(options.space)
    objectives = required_objectives(options, scenario)
    feasible = read_feasible(options.feasible, scenario)
    if len(options.tables) < 2:
        raise ScenarioError("compare needs two CSV files or more, one a device")
    measured = [read_measurements(path, space, objectives, feasible) for path in options.tables]
    values = _aligned(space, objectives, measured)
    answer = [
        pair
        for column, objective in enumerate(objectives)
        for pair in _pairs(options, objective, values[:, :, column])
    ]
    if options.json:
        sys.stdout.write(json.dumps(answer, indent=2) + "\n")
    else:
        sys.stdout.write("\n".join(map(_line, answer)) + "\n")
    return 0


def _aligned(
    space: Space, objectives: list[Objective], measured: list[list[Measurement]]
) -> NDArray[np.float64]:
    """Return (devices, configurations, objectives) mean values, NaN where a device has none.

    Rows with a bound are left out.
    """
    per_device: list[dict[int, list[list[float]]]] = []
    for device in measured:
        rows: dict[int, list[list[float]]] = {}
        for configuration, values in device:
            if values is not None and not censored_names(values):
                rows.setdefault(space.encode(configuration), []).append(list(values.values()))
        per_device.append(rows)
    column = {index: number for number, index in enumerate(sorted(set().union(*per_device)))}
    table = np.full((len(per_device), len(column), len(objectives)), np.nan)
    for device_number, rows in enumerate(per_device):
        for index, several in rows.items():
            table[device_number, column[index]] = np.mean(several, axis=0)
    return table


def _pairs(
    options: argparse.Namespace, objective: Objective, values: NDArray[np.float64]
) -> list[dict[str, Any]]:
    ranks = ranks_of_best(values, objective.maximise)
    return [
        {
            "objective": objective.name,
            "devices": [str(options.tables[i]), str(options.tables[j])],
            "common": int((~np.isnan(values[[i, j]]).any(axis=0)).sum()),
            "logarithms": options.log,
            **_coefficients(correlate(values[i], values[j], log=options.log)),
            "rank_of_firsts_best_on_second": None if np.isnan(ranks[i, j]) else float(ranks[i, j]),
            "rank_of_seconds_best_on_first": None if np.isnan(ranks[j, i]) else float(ranks[j, i]),
        }
        for i, j in itertools.combinations(range(len(values)), 2)
    ]


def _coefficients(correlation: Correlation | None) -> dict[str, Any]:
    if correlation is None:
        return {"pearson": None, "spearman": None}
    return {
        "pearson": vars(correlation.pearson),
        "spearman": vars(correlation.spearman),
    }


def _line(pair: dict[str, Any]) -> str:
    first, second = pair["devices"]
    text = f"{pair['objective']}: {first} and {second}, {pair['common']} common configurations: "
    if pair["pearson"] is None:
        text += f"too few for a correlation ({MINIMUM} different ones are needed)"
    else:
        of = " of logarithms" if pair["logarithms"] else ""
        text += f"Pearson{of} {_estimate(pair['pearson'])}, Spearman {_estimate(pair['spearman'])}"
    if pair["rank_of_firsts_best_on_second"] is not None:
        there, back = pair["rank_of_firsts_best_on_second"], pair["rank_of_seconds_best_on_first"]
        text += f"; the first's best is number {there:g} on the second, the second's {back:g} on the first"
    return text


def _estimate(values: dict[str, float]) -> str:
    estimate = Estimate(**values)
    return f"{estimate.value:.3f} ({estimate.low:.3f} to {estimate.high:.3f})"
