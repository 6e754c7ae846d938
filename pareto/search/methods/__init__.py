"""The search methods, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pareto.errors import MethodError
from pareto.search.methods.algorithm1 import Algorithm1
from pareto.search.methods.bayesian import Bayesian
from pareto.search.methods.method import Method
from pareto.search.methods.random import Random

METHODS: dict[str, type[Method]] = {
    "bayesian": Bayesian,
    "algorithm1": Algorithm1,
    "random": Random,
}
DEFAULT = "bayesian"
LARGEST_OPTION = 1_000_000  # more than needed in practice, and still fits into memory

__all__ = ["DEFAULT", "METHODS", "Method", "create"]


def create(name: str, options: Mapping[str, Any]) -> Method:
    """Return a fresh method. Raises MethodError for an unknown name, an unknown option or a bad value."""
    if not isinstance(name, str) or name not in METHODS:
        raise MethodError(f"no method {name!r}: there are {', '.join(METHODS)}")
    kind = METHODS[name]
    defaults = kind.defaults()
    for option, value in options.items():
        if option not in defaults:
            raise MethodError(
                f"method {name!r} has no option {option!r}: it has {', '.join(defaults) or 'none'}"
            )
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= LARGEST_OPTION:
            raise MethodError(
                f"option {option!r} must be a whole number from 1 to {LARGEST_OPTION:,}, not {value!r}"
            )
    return kind(**options)
