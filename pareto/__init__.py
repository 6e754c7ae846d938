"""Multi-objective exploration of discrete design spaces, by ask and tell.

`pareto.fronts.front` needs NumPy only; the names below load their modules when they are first used, so a
program that only reads a front never imports a model library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto.fronts.censored import Censored
    from pareto.fronts.objective import Objective
    from pareto.search.explorer import Explorer, Proposal
    from pareto.spaces.scenario import Scenario
    from pareto.spaces.space import Configuration, Space

__all__ = ["Censored", "Configuration", "Explorer", "Objective", "Proposal", "Scenario", "Space"]

_HOMES = {
    "Censored": "pareto.fronts.censored",
    "Configuration": "pareto.spaces.space",
    "Explorer": "pareto.search.explorer",
    "Objective": "pareto.fronts.objective",
    "Proposal": "pareto.search.explorer",
    "Scenario": "pareto.spaces.scenario",
    "Space": "pareto.spaces.space",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pareto' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
