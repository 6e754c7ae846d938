"""HyperMapper 2: random forests on log objectives, random Chebyshev scalarisations, learnt feasibility.

It takes limits as feasibility of the point. Its own defaults otherwise; the first `INITIAL` points are the
default configuration and random ones, as many as the method it is compared with starts from.
"""

from __future__ import annotations

import json
import os
import random
import tempfile
from pathlib import Path

import numpy as np
from hypermapper import models, optimizer
from sklearn.preprocessing import OneHotEncoder
from table import Table, answer

INITIAL = 40

# It names an argument `sparse` that scikit-learn has renamed since; without this, categories fail.
models.OneHotEncoder = lambda categories, sparse: OneHotEncoder(categories=categories, sparse_output=sparse)


def search(table: Table) -> None:
    # It has no seed of its own: it draws from the global generators.
    random.seed(table.seed)
    np.random.seed(table.seed)
    names = [f"f{number}" for number in range(table.objectives)]
    parameters = {}
    for name in table.axes:
        positions = list(range(table.size(name)))
        if table.ordered[name]:
            parameters[name] = {
                "parameter_type": "ordinal",
                "values": positions,
                "parameter_default": table.default[name],
            }
        else:
            parameters[name] = {
                "parameter_type": "categorical",
                "values": [str(position) for position in positions],
                "parameter_default": str(table.default[name]),
            }
    learns_feasibility = table.constraints > 0
    initial = min(INITIAL, table.budget)

    def look_up(configuration: dict) -> dict:
        outcome = table.evaluate(configuration)
        values = dict(zip(names, outcome.objectives, strict=True))
        return values | ({"Valid": outcome.feasible} if learns_feasibility else {})

    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        scenario = {
            "application_name": "peer",
            "optimization_objectives": names,
            "run_directory": folder,
            "design_of_experiment": {"doe_type": "random sampling", "number_of_samples": initial},
            "optimization_iterations": table.trials - initial,
            "models": {"model": "random_forest"},
            "number_of_cpus": 1,
            "input_parameters": parameters,
        }
        if learns_feasibility:
            scenario["feasible_output"] = {
                "name": "Valid",
                "enable_feasible_predictor": True,
                "true_value": "True",
                "false_value": "False",
            }
        path = Path(folder) / "scenario.json"
        path.write_text(json.dumps(scenario), encoding="utf-8")
        optimizer.optimize(str(path), look_up)
        os.chdir("/")


if __name__ == "__main__":
    answer(search, ["hypermapper", "scikit-learn"])
