"""Conditions for calling a configuration best: it must work on all sequences, also on held-out ones."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from wire.front import SequenceResult

# On a held-out sequence, the error may be FACTOR times the default's plus MARGIN (m).
FACTOR, MARGIN = 1.5, 0.01


class Results(NamedTuple):
    """The results of a configuration on sequences learned on, and on held-out ones."""

    learned_on: Sequence[SequenceResult]
    held_out: Sequence[SequenceResult]


def bound(default_error: float) -> float:
    """The largest allowed error (m) on a held-out sequence, given that of the default (m)."""
    return FACTOR * default_error + MARGIN


def objections(own: Results, default: Results, limit: float) -> Iterator[str]:
    """The reasons why a configuration with `own` results may not be called best; none if it may.

    Its error must stay below `limit` (m) on every sequence learned on, and within `bound` on every held-out
    one. It must be measured wherever the default is, and must not lose tracking in more frames than the
    default.
    """
    for kind in Results._fields:
        beside = {result.sequence: result for result in getattr(default, kind)}
        for result in getattr(own, kind):
            name = result.sequence
            if name not in beside:
                yield f"the default was not measured on {name}"
                continue
            yield from _lost(result, beside[name])
            largest = bound(beside[name].ate_max)
            if kind == "learned_on" and not result.ate_max < limit:
                yield f"{_error(result)}, not below {100 * limit:g} cm"
            if kind == "held_out" and not result.ate_max <= largest:
                times = f"{FACTOR:g} times the default's and {100 * MARGIN:g} cm"
                yield f"{_error(result)}, more than {100 * largest:.1f} cm ({times})"
        for name in sorted(beside.keys() - {result.sequence for result in getattr(own, kind)}):
            yield f"it was not measured on {name}"


def generalises(own: Results, default: Results) -> bool:
    """Whether nothing on the held-out sequences speaks against calling a configuration best."""
    return not any(objections(Results((), own.held_out), Results((), default.held_out), math.inf))


def _lost(result: SequenceResult, default: SequenceResult) -> Iterator[str]:
    if result.lost > default.lost:
        yield (
            f"tracking is lost in {result.lost} frames of {result.sequence}, with the default in "
            f"{default.lost}"
        )


def _error(result: SequenceResult) -> str:
    return f"its error on {result.sequence} is {100 * result.ate_max:.1f} cm"
