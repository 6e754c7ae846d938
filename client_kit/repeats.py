"""Whether a session goes on: until its intervals are tight enough, or its time or its runs are used up."""

from collections.abc import Sequence

from client_kit.manifest import MOST_RUNS, Protocol
from client_kit.session import Run, speedup_of

DEFAULT = "default"


def further(runs: Sequence[Run], protocol: Protocol, seconds_left: float, run_seconds: float) -> list[str]:
    """The next runs, default first and last, or none.

    Those configurations go on whose speedup has an interval wider than the protocol's precision; one whose
    last run failed, or whose runs lose the trajectory, does not: its speed counts for nothing. They run
    forwards and back, as ABBA does, so that a steady drift weighs on all alike. `run_seconds` is what a run
    takes on average; a round that would not end in `seconds_left` is not begun.
    """
    last = {run.configuration: run for run in runs}
    running = [name for name, run in last.items() if run.status == "ok"]
    names = [name for name in running if name != DEFAULT and _loose(runs, name, protocol)]
    if not names or DEFAULT not in running:
        return []
    forwards = [DEFAULT, *names]
    following = [*forwards, *reversed(forwards)]
    most = max(sum(run.configuration == name for run in runs) for name in forwards)
    if most + 2 > protocol.max_repeats or len(runs) + len(following) > MOST_RUNS:
        return []
    return following if len(following) * run_seconds <= seconds_left else []


def _loose(runs: Sequence[Run], name: str, protocol: Protocol) -> bool:
    speedup = speedup_of(runs, name, protocol)
    if speedup is None:
        return False
    return speedup.half_width is None or speedup.half_width > protocol.precision
