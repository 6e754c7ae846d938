"""SMAC3: random forests and expected improvement of ParEGO's scalarisation, on log objectives.

It has no limits: what exceeds them is given values behind them (`penalised`), which ParEGO's Chebyshev
scalarisation then avoids. The default configuration is evaluated first.
"""

from __future__ import annotations

import logging
import tempfile
import warnings
from pathlib import Path

import numpy as np
from ConfigSpace import Categorical, Configuration, ConfigurationSpace, Integer
from smac import HyperparameterOptimizationFacade as Facade
from smac import Scenario
from smac.multi_objective.parego import ParEGO
from table import Outcome, Table, answer


def penalised(table: Table, outcome: Outcome) -> list[float]:
    """Objectives of which none is better than its limit where any limit is exceeded."""
    if outcome.feasible or table.limits is None:
        return list(outcome.objectives)
    # A tenth of the excess keeps the way back visible without stretching ParEGO's normalised range.
    beyond = 0.1 * sum(max(part, 0.0) for part in outcome.excess)
    return np.maximum(outcome.objectives, table.limits + beyond).clip(max=table.limits + 1.0).tolist()


def search(table: Table) -> None:
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    space = ConfigurationSpace(seed=table.seed)
    for name in table.axes:
        last, default = table.size(name) - 1, table.default[name]
        if table.ordered[name]:
            space.add(Integer(name, (0, last), default=default))
        else:
            space.add(Categorical(name, list(range(last + 1)), default=default))
    names = [f"f{number}" for number in range(table.objectives)]

    def look_up(configuration: Configuration, seed: int = 0) -> dict[str, float]:
        values = penalised(table, table.evaluate(dict(configuration)))
        return dict(zip(names, values, strict=True))

    with tempfile.TemporaryDirectory() as folder:
        scenario = Scenario(
            space,
            objectives=names,
            n_trials=table.trials,
            deterministic=True,
            seed=table.seed,
            output_directory=Path(folder),
        )
        initial = Facade.get_initial_design(
            scenario, n_configs=min(40, table.budget) - 1,
            additional_configs=[space.get_default_configuration()],
        )  # fmt: skip
        Facade(
            scenario,
            look_up,
            initial_design=initial,
            multi_objective_algorithm=ParEGO(scenario),
            overwrite=True,
        ).optimize()


if __name__ == "__main__":
    answer(search, ["smac", "ConfigSpace"])
