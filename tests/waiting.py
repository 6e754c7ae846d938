"""Waiting for what comes a moment later: the only place of the tests that sleeps."""

import time
from collections.abc import Callable
from typing import Any

PATIENCE_SECONDS = 180.0


def until(
    condition: Callable[[], Any],
    patience: float = PATIENCE_SECONDS,
    pause: float = 0.05,
    seen: Callable[[], Any] | None = None,
) -> Any:
    """What `condition` gives once that is true, asked every `pause` seconds.

    AssertionError when `patience` seconds are over, with what it gave last, and what `seen` then gives: the
    state that a reader of the failure needs.
    """
    limit = time.monotonic() + patience
    while not (value := condition()):
        if time.monotonic() >= limit:
            state = "" if seen is None else f"; seen: {seen()}"
            raise AssertionError(f"waited {patience:.0f} s in vain; last: {value!r}{state}")
        time.sleep(pause)
    return value
