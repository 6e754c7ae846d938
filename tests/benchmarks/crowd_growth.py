"""What a crowd costs as it grows: the same questions and one more submission at each of several sizes.

At each size the database is filled with made-up runs (`crowd_filling`), everything is computed again from
them, one submission after another of the most popular device is sent and worked through, and public reads
are timed, warm; at the largest size also cold: server and database just started, nothing of their files in
memory. CPU counts, which a busy machine changes less than time. Part of `python -m tests.benchmarks.crowd`.
"""

import gzip
import json
import resource
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.crowd_explorations import cpu_seconds
from tests.benchmarks.crowd_load import Connection, Web, bodies, forget, read
from tests.builders.documents import device_document
from tests.services.intake import LIMITS, prepare
from tests.services.postgresql import PostgreSQL
from tests.services.program import ROOT
from tests.services.serving import Services, Serving, command, environment, shell
from tests.waiting import until

SUBMISSIONS = 40
COLD_STARTS = 3
POPULAR = "google-pixel-0000"
# What every page costs, and every answer.
BOUNDS = {"text": "/about/", "word": "/healthz"}
CHART = "/figures/speedups.json"
READS = {
    "speedups": "/api/v1/speedups",
    "devices": "/api/v1/devices",
    "one device": f"/api/v1/devices/{POPULAR}",
    "its page": f"/devices/{POPULAR}/",
    "home page": "/",
    "list": "/devices/",
    "transfer": "/transfer/",
} | BOUNDS


def bound_of(path: str) -> str:
    """The name of the read that bounds `path`'s."""
    return "word" if path.startswith("/api/") else "text"


@dataclass(frozen=True)
class Plan:
    """Sizes in runs, ascending, and the devices that they are spread over."""

    sizes: Sequence[int]
    devices: int


FULL = Plan((10_000, 100_000, 1_000_000), 2000)
QUICK = Plan((5_000, 20_000), 200)


def measure(
    folder: Path, plan: Plan, database: PostgreSQL | None, say: Callable[[str], Any]
) -> dict[str, Any]:
    """The figures at every size of `plan`, by size, in `folder` and on `database` or SQLite."""
    var, services = folder / "var", dict(LIMITS)
    if database is not None:
        services["DATABASE_URL"] = database.url
    prepare(var, services)
    found: dict[str, Any] = {}
    stored, empty = 0, _table_bytes(var, services)
    for size in plan.sizes:
        row: dict[str, Any] = {"filled": fill(var, services, size - stored, plan.devices)}
        stored = size
        row["recomputed"] = _recompute(var, services, size)
        row["bytes_a_run"] = _bytes_a_run(empty, _table_bytes(var, services), size)
        row |= _ask(var, services, database, cold=size == plan.sizes[-1])
        stored += SUBMISSIONS * 4
        found[str(size)] = row
        say(_line(size, row))
        say(f"{'bytes a run':>22} {row['bytes_a_run']}")
    return found


# The bytes of each table with its indexes.
TABLE_BYTES = """
import json
from django.db import connection
statements = {
    "sqlite": "SELECT tbl_name, sum(pgsize) FROM dbstat JOIN sqlite_schema USING (name) GROUP BY tbl_name",
    "postgresql": "SELECT relname, pg_total_relation_size(oid) FROM pg_class "
    "WHERE relkind = 'r' AND relnamespace = 'public'::regnamespace",
}
with connection.cursor() as cursor:
    cursor.execute(statements[connection.vendor])
    print(json.dumps(dict(cursor.fetchall())))
"""


def _table_bytes(var: Path, services: Services) -> dict[str, int]:
    printed = shell(var, TABLE_BYTES, **services)
    sizes: dict[str, int] = json.loads(printed.splitlines()[-1])
    return sizes


def _bytes_a_run(before: dict[str, int], after: dict[str, int], runs: int) -> dict[str, int]:
    """What each table grew by for each run, largest first, from a byte on, and all together."""
    grown = {table: (size - before.get(table, 0)) / runs for table, size in after.items()}
    largest = sorted(grown.items(), key=lambda item: -item[1])
    return {"all": round(sum(grown.values()))} | {table: round(size) for table, size in largest if size >= 1}


# The night's export would take the worker's time while one more submission is measured.
NO_EXPORT = """
from django.utils import timezone
from crowd.results.models import Export
now = timezone.now()
Export.objects.create(started_at=now, touched_at=now, published_at=now)
"""


def _ask(var: Path, services: Services, database: PostgreSQL | None, cold: bool) -> dict[str, Any]:
    """One more submission, and every read: warm, and `cold` as well."""
    done = command(var, "shell", "--no-imports", "-c", NO_EXPORT, **services)
    assert done.returncode == 0, done.stderr
    with Serving(var, services) as server:
        pids = server.pids("granian") + ([database.process.pid] if database else [])
        row: dict[str, Any] = {"one_more": _one_more(server, SUBMISSIONS)}
        row["warm"] = {
            name: read(server.port, path, lambda: cpu_seconds(pids)) for name, path in READS.items()
        }
        asked = urllib.request.Request(f"{server.url}{CHART}", headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(asked) as answer:
            row["chart_kb"] = round(len(answer.read()) / 1e3, 1)
    return row | ({"cold": _cold(var, services, database)} if cold else {})


def heading() -> str:
    """The columns of `measure`'s lines."""
    return (
        f"{'runs':>10} {'fill s':>8} {'recompute s':>12} {'us a run':>9} {'web ms':>8} {'worker ms':>10}"
        + "".join(f"{name:>15}" for name in READS)
        + "   (one more submission: CPU ms; reads: p95 ms and CPU ms, warm; cold: slowest)"
    )


def _line(size: int, row: dict[str, Any]) -> str:
    def reads(kind: str, *figures: str) -> str:
        each = (" ".join(str(row[kind][name][figure]) for figure in figures) for name in READS)
        return "".join(f"{figure:>15}" for figure in each)

    made = [
        row[step][figure] if step in row else "-"
        for step, figure in (("filled", "seconds"), ("recomputed", "seconds"), ("recomputed", "cpu_us_a_run"))
    ]
    line = (
        f"{size:>10} {made[0]:>8} {made[1]:>12} {made[2]:>9} {row['one_more']['web_cpu_ms']:>8} "
        f"{row['one_more']['worker_cpu_ms']:>10}{reads('warm', 'p95_ms', 'server_cpu_ms')}"
    )
    return f"{line}\n{'cold':>62}{reads('cold', 'slowest_ms')}" if "cold" in row else line


def fill(var: Path, services: Services, runs: int, devices: int) -> dict[str, float]:
    """Add `runs` runs of `devices` devices, which wait for their summaries."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.crowd_filling", str(runs), str(devices)],
        cwd=ROOT,
        env=environment(var, **services, DJANGO_SETTINGS_MODULE="crowd.settings"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    figures: dict[str, float] = json.loads(done.stdout)
    return figures | {"runs_per_second": round(runs / figures["seconds"])}


def _recompute(var: Path, services: Services, runs: int) -> dict[str, float]:
    """Everything from the raw runs, by the one command; what PostgreSQL does is in the seconds only."""
    before, begun = children_cpu(), time.perf_counter()
    done = command(var, "results", "recompute", "--all", **services)
    assert done.returncode == 0, done.stderr
    taken, spent = time.perf_counter() - begun, children_cpu() - before
    return {"seconds": round(taken, 1), "cpu_us_a_run": round(1e6 * spent / runs, 1)}


def children_cpu() -> float:
    """CPU seconds of the processes that this one started and waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _one_more(server: Serving, count: int) -> dict[str, float]:
    """CPU of web server and worker for a submission of four runs, and how long it takes, one by one."""
    connection, token = Connection(server.port), server.enrol()
    popular = device_document("Pixel 0000")
    connection.submit(token, bodies(1, lambda _: popular)[0])  # warms up
    until(lambda: server.waiting() == 0)
    before = {word: cpu_seconds(server.pids(word)) for word in ("granian", "--beat")}
    sent = bodies(count, lambda _: popular)
    times = [connection.submit(token, body) for body in sent]
    until(lambda: server.waiting() == 0, 300)
    spent = {word: cpu_seconds(server.pids(word)) - value for word, value in before.items()}
    # They went to the device with the most sessions, or this measures something else.
    _, shown = server.call("GET", f"/api/v1/devices/{POPULAR}")
    newest = json.loads(gzip.decompress(sent[-1]))["sessions"][0]["id"]
    assert newest in [session["id"] for session in shown["sessions"]], f"{newest} is not of {POPULAR}"
    return {
        "web_cpu_ms": round(1e3 * spent["granian"] / count, 2),
        "worker_cpu_ms": round(1e3 * spent["--beat"] / count, 2),
        "p50_ms": round(1e3 * sorted(times)[count // 2], 2),
    }


def _cold(var: Path, services: Services, database: PostgreSQL | None) -> dict[str, dict[str, float]]:
    """The slowest first answer of each read over COLD_STARTS starts."""
    slowest = dict.fromkeys(READS, 0.0)
    for _ in range(COLD_STARTS):
        for name, path in READS.items():
            if database is not None:
                database.kill()
                forget(database.folder)
                database.start()
            else:
                forget(var)
            with Web(var, services) as server:
                status, seconds, _ = Connection(server.port).ask("GET", path)
                assert status == 200, f"{path}: {status}"
                slowest[name] = max(slowest[name], seconds)
    return {name: {"slowest_ms": round(seconds * 1e3, 1)} for name, seconds in slowest.items()}
