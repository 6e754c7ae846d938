"""When a configuration may be called best: it holds on every sequence, also on those not learned on."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

# On a sequence that nobody learned on, an error may be so many times the default's, and so much (m) more.
FACTOR, MARGIN = 1.5, 0.01

# {"sequence", "ate_max" (m), "lost" (frames)}: the worst over all measurements of that sequence
Result = Mapping[str, Any]


def bound(default_error: float) -> float:
    """The largest error (m) allowed where the default's is DEFAULT_ERROR (m)."""
    return FACTOR * default_error + MARGIN


def objections(
    learned_on: Iterable[Result], held_out: Iterable[Result], default_held_out: Iterable[Result], limit: float
) -> Iterator[str]:
    """Why a configuration with these results may not be called best; nothing where it may.

    Its error must stay below LIMIT (m) on every sequence learned on, and within `bound` of the default's on
    every one held out, at least on those of the default. It must never lose the camera.
    """
    defaults = {result["sequence"]: result["ate_max"] for result in default_held_out}
    for result in learned_on:
        yield from _lost(result)
        if not result["ate_max"] < limit:
            yield f"{_error(result)}, not below {100 * limit:g} cm"
    held_out = list(held_out)
    for result in held_out:
        yield from _lost(result)
        name = result["sequence"]
        if name not in defaults:
            yield f"the default was not measured on {name}"
        elif not result["ate_max"] <= (most := bound(defaults[name])):
            yield f"{_error(result)}, more than {100 * most:.1f} cm ({FACTOR:g} times the default's and 1 cm)"
    for name in sorted(defaults.keys() - {result["sequence"] for result in held_out}):
        yield f"it was not measured on {name}"


def _lost(result: Result) -> Iterator[str]:
    if result["lost"]:
        yield f"the camera is lost in {result['lost']} frames of {result['sequence']}"


def _error(result: Result) -> str:
    return f"its error on {result['sequence']} is {100 * result['ate_max']:.1f} cm"
