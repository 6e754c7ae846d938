"""What the user expects of a parameter: a weight for each value, large where good configurations are likely.

The names are HyperMapper's: beta distributions over the range of values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.errors import SpaceError
from pareto.numbers import is_finite, is_number

SHAPES = {"gaussian": (3.0, 3.0), "decay": (0.8, 1.0), "exponential": (1.0, 0.8)}  # alpha and beta
LEAST = 1e-3  # of the largest weight: no value is ruled out


@dataclass(frozen=True)
class Normal:
    """A normal distribution of the values, which are numbers."""

    mean: float
    deviation: float


UserPrior = str | Normal | tuple[float, ...]


def read_user_prior(name: str, raw: object) -> UserPrior:
    """Return the prior of parameter `name` from JSON. Raises SpaceError."""
    match raw:
        case str() if raw in SHAPES:
            return raw
        case {"mean": mean, "deviation": deviation, **rest} if not rest and _positive([deviation]):
            if is_number(mean) and is_finite(mean):
                return Normal(float(mean), float(deviation))
        case [*weights] if _positive([weight for weight in weights if weight != 0]):
            return tuple(float(weight) for weight in weights)  # type: ignore[arg-type]
    raise SpaceError(
        f"parameter {name!r}: a prior is one of {', '.join(SHAPES)}, a list with a weight for each value, or "
        f'{{"mean": .., "deviation": ..}} with a deviation above 0; not {raw!r:.80}'
    )


def written_user_prior(prior: UserPrior) -> object:
    """Return the JSON that `read_user_prior` reads."""
    if isinstance(prior, Normal):
        return {"mean": prior.mean, "deviation": prior.deviation}
    return prior if isinstance(prior, str) else list(prior)


def value_weights(prior: UserPrior, values: Sequence[object]) -> NDArray[np.float64]:
    """Return the weights of `values`, the largest 1 and none below LEAST."""
    weights: NDArray[np.float64]
    if isinstance(prior, str):
        alpha, beta = SHAPES[prior]
        share = (np.arange(len(values)) + 0.5) / len(values)
        weights = share ** (alpha - 1) * (1 - share) ** (beta - 1)
    elif isinstance(prior, Normal):
        distance = (np.array(values, dtype=np.float64) - prior.mean) / prior.deviation
        weights = np.exp((np.min(distance**2) - distance**2) / 2)
    else:
        weights = np.array(prior)
    floored: NDArray[np.float64] = np.maximum(weights / weights.max(), LEAST)
    return floored


def _positive(numbers: Sequence[object]) -> bool:
    """Whether there are `numbers`, all of them finite and above 0."""
    return bool(numbers) and all(is_number(n) and is_finite(n) and n > 0 for n in numbers)  # type: ignore[arg-type, operator]
