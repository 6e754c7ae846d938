"""Multi-objective exploration of discrete design spaces, by ask and tell.

`pareto.front` needs NumPy only; the names below load their modules when they are first used, so that a
program which merely reads a front never imports a model library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto.explorer import Explorer, Proposal
    from pareto.objective import Objective
    from pareto.scenario import Scenario
    from pareto.space import Configuration, Space

__all__ = ["Configuration", "Explorer", "Objective", "Proposal", "Scenario", "Space"]

_HOMES = {
    "Configuration": "pareto.space",
    "Explorer": "pareto.explorer",
    "Objective": "pareto.objective",
    "Proposal": "pareto.explorer",
    "Scenario": "pareto.scenario",
    "Space": "pareto.space",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pareto' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
