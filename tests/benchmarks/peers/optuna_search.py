"""Optuna: NSGA-II, TPE or Gaussian processes (`method` nsga2, tpe, gp) on log objectives.

Limits and failures are its soft constraints. The default configuration is enqueued first.
"""

from __future__ import annotations

import warnings

import optuna
from table import Table, answer

POPULATION = 50


def sampler_for(table: Table) -> optuna.samplers.BaseSampler:
    """The sampler that the request names."""
    constraints = {"constraints_func": lambda trial: trial.user_attrs["excess"]} if table.constraints else {}
    if table.method == "nsga2":
        return optuna.samplers.NSGAIISampler(seed=table.seed, population_size=POPULATION, **constraints)
    if table.method == "tpe":
        return optuna.samplers.TPESampler(seed=table.seed, multivariate=True, **constraints)
    return optuna.samplers.GPSampler(seed=table.seed, deterministic_objective=True, **constraints)


def search(table: Table) -> None:
    warnings.simplefilter("ignore")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(directions=["minimize"] * table.objectives, sampler=sampler_for(table))
    study.enqueue_trial(table.default)

    def look_up(trial: optuna.Trial) -> tuple[float, ...]:
        positions = {}
        for name in table.axes:
            last = table.size(name) - 1
            positions[name] = (
                trial.suggest_int(name, 0, last)
                if table.ordered[name]
                else trial.suggest_categorical(name, range(last + 1))
            )
        outcome = table.evaluate(positions)
        trial.set_user_attr("excess", outcome.excess)
        return outcome.objectives

    study.optimize(look_up, n_trials=table.trials)


if __name__ == "__main__":
    answer(search, ["optuna"])
