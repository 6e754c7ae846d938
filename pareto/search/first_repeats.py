"""The first repeats of a search, by which it learns how noisy measurements are."""

from __future__ import annotations

from collections import Counter

from pareto.search.history import History
from pareto.search.repeats import REPEATS

PLACE = 8  # of the default's second measurement
AGREED, DIFFERED = 2, 4  # first repeats where all agree to the last digit, and otherwise
WORTH = 15  # measurements: a smaller budget has none to spare, and its noise stays unknown


def first_repeats(history: History, count: int, budget: int | None = None) -> dict[int, int]:
    """Return which of the next `count` proposals are repeats, as their places and points.

    Measurement number PLACE is the second one of the default, or of the first point that succeeded. If the
    two agree to the last digit, one more point is repeated. If any differ, the default is measured a third
    time, and both ends of the front a second time. A configuration that failed once is not repeated, and
    nothing is while a repeat is pending, or after REPEATS of them failed.
    """
    if history.rounds is not None or (budget is not None and budget < WORTH):
        return {}
    repeats = history.repeats()
    differ = any(len(set(values)) > 1 for values in repeats)
    freedom = sum(len(values) - 1 for values in repeats)
    missing = (DIFFERED if differ else AGREED) - freedom
    attempts = Counter({index: len(values) for index, values in history.results.items()})
    attempts.update(index for index, _ in history.pending)
    again = sum(attempts.values()) - len(attempts)
    if missing <= 0 or any(attempts[index] > 1 for index in history.waiting()) or again - freedom >= REPEATS:
        return {}
    default = history.space.encode(history.space.default)
    exact = history.measured()[0][history.exact()].tolist()
    usable = sorted((index for index in exact if None not in history.results[index]), key=default.__ne__)
    if not freedom:
        place = max(PLACE - 1 - sum(attempts.values()), 0)
        points = usable[:1] if attempts else [default]
        return dict(zip([place], points, strict=False)) if place < count else {}
    if differ:
        front = [index for index in history.front()[0].tolist() if index in usable[1:]]
        most = dict.fromkeys([*front[:1], *front[-1:]], 2) | dict.fromkeys(usable[:1], 3)
    else:
        most = dict.fromkeys(usable, 2)
    wanted = [index for index, times in most.items() if attempts[index] < times]
    return dict(enumerate(wanted[: min(missing, count)]))
