"""pymoo's NSGA-II with its operators for integers and choices, on log objectives, limits as constraints."""

from __future__ import annotations

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.mixed import MixedVariableDuplicateElimination, MixedVariableMating, MixedVariableSampling
from pymoo.core.population import Population
from pymoo.core.problem import ElementwiseProblem
from pymoo.core.variable import Choice, Integer
from pymoo.optimize import minimize
from table import Table, answer

POPULATION = 50


class Problem(ElementwiseProblem):
    """The table as pymoo wants it."""

    def __init__(self, table: Table) -> None:
        variables = {
            name: Integer(bounds=(0, table.size(name) - 1))
            if table.ordered[name]
            else Choice(options=list(range(table.size(name))))
            for name in table.axes
        }
        self.table = table
        super().__init__(vars=variables, n_obj=table.objectives, n_ieq_constr=table.constraints)

    def _evaluate(self, x: dict, out: dict, *_: object, **__: object) -> None:
        outcome = self.table.evaluate(x)
        out["F"] = list(outcome.objectives)
        out["G"] = list(outcome.excess)[: self.table.constraints]


def search(table: Table) -> None:
    problem = Problem(table)
    np.random.seed(table.seed)
    first = MixedVariableSampling()(problem, POPULATION - 1, random_state=np.random.default_rng(table.seed))
    start = Population.merge(Population.new(X=[table.default]), first)
    algorithm = NSGA2(
        pop_size=POPULATION,
        sampling=start,
        mating=MixedVariableMating(eliminate_duplicates=MixedVariableDuplicateElimination()),
        eliminate_duplicates=MixedVariableDuplicateElimination(),
    )
    minimize(problem, algorithm, ("n_eval", table.trials), seed=table.seed, verbose=False)


if __name__ == "__main__":
    answer(search, ["pymoo"])
