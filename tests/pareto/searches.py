"""A small space, a made-up program to measure in it, and a search that spends a budget."""

from pareto import Explorer
from tests.builders.spaces import parameter, space_of

SPACE = space_of(
    size=parameter([1, 2, 4, 8, 16, 32], default=8),
    rate=parameter(range(1, 10), default=2),
    kernel=["box", "cone", "ball"],
    fast=bool,
)
OPTIONS = {
    "bayesian": {"initial": 8, "candidates": 100, "points": 40},
    "algorithm1": {"initial": 12, "trees": 8},
    "random": {},
}


def measure(configuration):
    """Error and time of a made-up program; None where it crashes."""
    if configuration["kernel"] == "ball" and configuration["size"] >= 16:
        return None
    error = 0.3 / configuration["size"] + 0.01 * configuration["rate"] + 0.02 * configuration["fast"]
    seconds = configuration["size"] ** 1.5 / configuration["rate"] * (0.5 if configuration["fast"] else 1.0)
    return {"error": error * (1.2 if configuration["kernel"] == "cone" else 1.0), "seconds": seconds}


def explorer_of(method, objectives=("error", "seconds"), limits=None, seed=1, space=SPACE):
    return Explorer(space, objectives, limits, seed=seed, method=method, **OPTIONS[method])


def spend(explorer, budget, batch=5, measure=measure):
    asked = []
    while len(asked) < budget and (configurations := explorer.ask(min(batch, budget - len(asked)))):
        explorer.tell(configurations, [measure(item) for item in configurations])
        asked += configurations
    return asked


def advance(explorer, count, measure):
    """Propose `count` points, tell what `measure` gives for each proposal, and return the proposals."""
    proposals = explorer.propose(count)
    explorer.tell([item.configuration for item in proposals], [measure(item) for item in proposals])
    return proposals


def repeats_in(asked, space=SPACE):
    """How many of `asked` were asked before: one, where a search learns that there is no noise."""
    return len(asked) - len({space.encode(item) for item in asked})
