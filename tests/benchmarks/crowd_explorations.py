"""What an evaluation costs besides the measurement itself, per broker and database.

Thousands of evaluations that take no time (looked up in a table), found at random, on four workers of one
device, with everything else as its owner runs it. The CPU of every process counts from the first message to
the last, idle polling included: the device's workers and the server's own, the web server, the broker
(RabbitMQ's Erlang machine with all it starts) and the database with its connections' processes; not the
supervisor, which looks at its children ten times a second. Part of `python -m tests.benchmarks.crowd`;
alone: python -m tests.benchmarks.crowd_explorations.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from tests.services import exploring
from tests.services.installation import Installation
from tests.services.postgresql import PostgreSQL
from tests.services.program import family
from tests.services.rabbitmq import RabbitMQ
from tests.services.redis import Redis
from tests.waiting import until

EVALUATIONS = 2000
WORKERS = 4
PATIENCE_SECONDS = 900.0
WISHES: dict[str, Any] = {
    "machines": WORKERS,
    "method": "random",
    "budget": EVALUATIONS,
    "batch": 100,
    "recheck": False,
    "repeats": 0,
}
# As `manage.py serve` starts its own.
OPTIONS = ("--pool", "solo", "--without-gossip", "--without-mingle", "--without-heartbeat")
LOOP = 5_000_000
# As they are by default: what the tests make quick would cost here.
ORDINARY = {"FRONTRUNNER_LEASE_SECONDS": "90"}
COMBINATIONS = {
    "filesystem, sqlite": (None, None),
    "redis, postgresql": (Redis, PostgreSQL),
    "rabbitmq, postgresql": (RabbitMQ, PostgreSQL),
}


def cpu_seconds(pids: Iterable[int]) -> float:
    """CPU so far of those processes, of their descendants, and of those that ended. Linux alone tells."""
    return cpu_of({member for ancestor in pids for member in family(ancestor)})


def cpu_of(pids: Iterable[int]) -> float:
    """As `cpu_seconds`, of those processes alone."""
    ticks = 0
    for pid in pids:
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended: its parent has its ticks
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += sum(int(field) for field in fields[11:15])  # own and ended children's, user and kernel
    return ticks / os.sysconf("SC_CLK_TCK")


def loop_seconds() -> float:
    """CPU of counting to LOOP, by which figures of busy and idle machines compare."""
    begun = time.process_time()
    for _ in range(LOOP):
        pass
    return time.process_time() - begun


def measure(name: str) -> dict[str, float] | str:
    """The figures of the combination `name` of COMBINATIONS; why there are none where a part is missing."""
    make_broker, make_database = COMBINATIONS[name]
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        try:
            broker = stack.enter_context(make_broker(Path(folder))) if make_broker else None
            database = stack.enter_context(make_database()) if make_database else None
        except (ImportError, FileNotFoundError) as error:
            return f"not installed here: {error}"
        installation = Installation(Path(folder) / "var", broker, database, WORKERS, OPTIONS, **ORDINARY)
        return _run(stack.enter_context(installation))


def _run(installation: Installation) -> dict[str, float]:
    def spent() -> dict[str, float]:
        web = installation.server.pids("granian")
        workers = [worker.process.pid for worker in installation.workers]
        groups = {
            "workers": workers + installation.server.pids("celery"),
            "web server": web,
            "broker": [installation.broker.process.pid] if installation.broker else [],
            "database": [installation.database.process.pid] if installation.database else [],
        }
        return {name: cpu_seconds(pids) for name, pids in groups.items()}

    logs = [worker.log for worker in installation.workers] + list(installation.var.glob("logs/worker*.log"))
    until(lambda: all(" ready." in log.read_text() for log in logs))
    loops = [loop_seconds()]
    before = spent()
    exploring.start(installation.var, installation.services, **WISHES)
    begun = time.perf_counter()
    until(lambda: installation.state() == "done", PATIENCE_SECONDS, pause=1.0)
    taken = time.perf_counter() - begun
    each = {name: 1e3 * (after - before[name]) / EVALUATIONS for name, after in spent().items()}
    loops.append(loop_seconds())
    return {f"{name.replace(' ', '_')}_ms": round(value, 2) for name, value in each.items()} | {
        "all_ms": round(sum(each.values()), 2),
        "evaluations_per_second": round(EVALUATIONS / taken, 1),
        "loop_s": round(sum(loops) / 2, 3),
    }


def compare(say: Callable[[str], Any]) -> dict[str, dict[str, float] | str]:
    """The figures of every combination; each is said as soon as it is known."""
    say(f"CPU ms an evaluation ({EVALUATIONS}, {WORKERS} workers)")
    columns = ("workers", "web server", "broker", "database", "all", "evaluations/s", "loop s")
    say(" " * 22 + "".join(f"{column:>14}" for column in columns))
    results = {}
    for name in COMBINATIONS:
        results[name] = row = measure(name)
        figures = row if isinstance(row, str) else "".join(f"{value:>14}" for value in row.values())
        say(f"{name:22}{figures}")
    return results


if __name__ == "__main__":
    compare(lambda line: print(line, flush=True))
