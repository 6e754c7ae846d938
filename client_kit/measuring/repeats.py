"""The end of a session of protocol 1: narrow intervals, or the limits of time or runs."""

from collections.abc import Sequence

from client_kit.delivery.manifest import MOST_RUNS, AdaptiveRepeats, Protocol
from client_kit.measuring.session import Run, speedup_of

DEFAULT = "default"


def next_runs(runs: Sequence[Run], protocol: Protocol, age_seconds: float, run_seconds: float) -> list[str]:
    """The next runs, default first and last, or none. A protocol without adaptive repeats has none.

    It includes configurations whose speedup has an interval wider than the protocol's precision, unless the
    last run failed or the trajectory was lost: their speed does not count. They run forwards and back (ABBA),
    so that a steady drift affects all equally. The session is `age_seconds` old and a run takes `run_seconds`
    on average: a round that would end too late is not started.
    """
    adaptive = protocol.adaptive
    if adaptive is None:
        return []
    last = {run.configuration: run for run in runs}
    running = [name for name, run in last.items() if run.status == "ok"]
    names = [name for name in running if name != DEFAULT and _loose(runs, name, protocol, adaptive)]
    if not names or DEFAULT not in running:
        return []
    forwards = [DEFAULT, *names]
    following = [*forwards, *reversed(forwards)]
    most = max(sum(run.configuration == name for run in runs) for name in forwards)
    if most + 2 > adaptive.max_repeats or len(runs) + len(following) > MOST_RUNS:
        return []
    in_time = age_seconds + len(following) * run_seconds <= adaptive.max_seconds
    return following if in_time else []


def _loose(runs: Sequence[Run], name: str, protocol: Protocol, adaptive: AdaptiveRepeats) -> bool:
    speedup = speedup_of(runs, name, protocol)
    if speedup is None:
        return False
    return speedup.half_width is None or speedup.half_width > adaptive.precision
