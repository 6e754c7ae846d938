"""What a crowd of millions of runs costs, on PostgreSQL: intake, and computing everything again.

A sample of 2 % has times of its own for each run. Its sessions are summarised by 1, 2 and 4 processes, each
time in a new copy of it, and all that they derive is compared. The copy of one process is multiplied by SQL
(`crowd_multiplying`) to all runs. Then submissions go to a small database and to the large one in turns.

CPU is that of web server and database together. Bytes are those of the write-ahead log, from a checkpoint on:
PostgreSQL writes each page as a whole when it first changes after one. Part of
`python -m tests.benchmarks.crowd`: --only growth --runs RUNS.
"""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import psycopg

from tests.benchmarks import crowd_multiplying
from tests.benchmarks.crowd_explorations import cpu_seconds
from tests.benchmarks.crowd_growth import children_cpu, fill
from tests.benchmarks.crowd_load import CLIENTS, Connection, Web, ingest
from tests.services.intake import LIMITS, prepare
from tests.services.postgresql import PostgreSQL
from tests.services.program import ROOT
from tests.services.serving import commands, environment, shell

DEVICES = 2000
SMALL = 10_000
SAMPLED = 50  # one of so many runs is in the sample
WORKERS = (1, 2, 4)
ROUNDS, SUBMISSIONS, TRACED = 5, 200, 20
# From the most popular device to a rare one: each client has one.
NAMES = ("Pixel 0000", "Pixel 0050", "Pixel 0500", "Pixel 1900")

# Everything that is derived, without keys and times of computing. PostgreSQL prints all bits of a float.
DERIVED = {
    "runs": "SELECT id, mean_us, fingerprint, state, reason FROM results_run",
    "summaries": "SELECT to_jsonb(summary) - 'id' - 'cohort_id' FROM results_sessionsummary summary",
    "figures": "SELECT to_jsonb(figure) - 'id' - 'computed_at' FROM results_devicespeedup figure",
    "outcomes": "SELECT device_id, to_jsonb(outcome) - 'id' - 'cohort_id' FROM results_outcome outcome "
    "JOIN results_cohort cohort ON cohort.id = cohort_id",
    "activity": "SELECT to_jsonb(activity) - 'id' FROM results_deviceactivity activity",
}
SUMMARISE = """
import json, time
from crowd.results.figures import sessions
keys = list(sessions.waiting_sessions().values_list("pk", flat=True))
sessions.summarise_session(keys.pop())  # warms up
begun = time.process_time()
for key in keys:
    sessions.summarise_session(key)
print(json.dumps([len(keys), time.process_time() - begun]))
"""


def measure(folder: Path, runs: int, server: PostgreSQL, say: Callable[[str], Any]) -> dict[str, Any]:
    """The figures at SMALL runs and at `runs`, or at as many as the disk has room for."""
    runs, reason = crowd_multiplying.affordable(runs, server.folder)
    say(reason or f"{runs} runs on {DEVICES} devices")
    sampled = max(runs // SAMPLED, SMALL)
    small = Place(folder, server, "small")
    small.fill(SMALL)
    sample = Place(folder, server, "sample", "small")
    small.recompute(1)
    sample.fill(sampled - SMALL)
    large = Place(folder, server, "large", "sample")
    split = {1: large.recompute(1) | large.derived()}
    say(f"{sampled} runs computed by 1 process: {split[1]}")
    filled = crowd_multiplying.multiply(large.url, runs // sampled - 1)
    runs = large.ask("SELECT count(*) FROM results_run")
    size = large.ask("SELECT pg_database_size(current_database())")
    filled |= {"bytes_a_run": round(size / runs), "again": large.recompute(1)}
    say(f"{runs} runs filled: {filled}")
    found: dict[str, Any] = {"runs": runs, "reason": reason, "filled": filled}
    found["intake"] = _in_turns({str(SMALL): small, str(runs): large}, say)
    found["rate"] = _rates(large)
    say(f"submissions a second by web processes: {found['rate']}")
    server.drop(large.name)
    for workers in WORKERS[1:]:
        copy = Place(folder, server, f"workers_{workers}", "sample")
        split[workers] = copy.recompute(workers) | copy.derived()
        say(f"{sampled} runs computed by {workers} processes: {split[workers]}")
        server.drop(copy.name)
    found["split"] = split
    found["same"] = all(row[name] == split[1][name] for row in split.values() for name in DERIVED)
    # The sample's summaries for all runs, and the figures as measured. By CPU: this machine may be busy.
    summaries, figures = (
        split[1]["summaries_cpu_s"] * runs / sampled,
        filled["again"]["figures_cpu_s"],
    )
    found["calculated_hours"] = {
        workers: round((summaries / workers + figures) / 3600, 2) for workers in WORKERS
    }
    say(f"all the same: {found['same']}; hours for all, calculated: {found['calculated_hours']}")
    return found


class Place:
    """A database called `name` on `server`, with a data folder of its own; a copy of `template`."""

    def __init__(self, folder: Path, server: PostgreSQL, name: str, template: str | None = None) -> None:
        self.name, self.server, self.var = name, server, folder / name
        self.url = server.create(name, template or "template1")
        self.services = LIMITS | {"DATABASE_URL": self.url}
        prepare(self.var, self.services) if template is None else self.var.mkdir()

    def ask(self, query: str) -> Any:
        """The one value that `query` gives."""
        with psycopg.connect(self.url, autocommit=True) as database:
            row = database.execute(query).fetchone()
        assert row is not None, query
        return row[0]

    def do(self, statement: str) -> None:
        """Execute `statement`."""
        with psycopg.connect(self.url, autocommit=True) as database:
            database.execute(statement)

    def fill(self, runs: int) -> None:
        """Add `runs` runs that wait for their summaries."""
        fill(self.var, self.services, runs, DEVICES)

    def recompute(self, workers: int) -> dict[str, Any]:
        """Seconds until `workers` processes summarised what waits, and then of the figures by one. CPU is
        that of the database, too."""
        begun, before = time.perf_counter(), self._cpu()
        started = [
            subprocess.Popen(
                [sys.executable, "manage.py", "results", "recompute", f"--part={number}/{workers}"],
                cwd=ROOT,
                env=environment(self.var, **self.services),
                stdout=subprocess.DEVNULL,
            )
            for number in range(1, workers + 1)
        ]
        assert [each.wait() for each in started] == [0] * workers
        summarised, between = time.perf_counter(), self._cpu()
        commands(self.var, "results recompute", **self.services)
        return {
            "summaries_s": round(summarised - begun, 1),
            "figures_s": round(time.perf_counter() - summarised, 1),
            "summaries_cpu_s": round(between - before, 1),
            "figures_cpu_s": round(self._cpu() - between, 1),
        }

    def _cpu(self) -> float:
        return children_cpu() + cpu_seconds([self.server.process.pid])

    def derived(self) -> dict[str, str]:
        """The digest of each of DERIVED."""
        lines = (
            "SELECT md5(string_agg(line, ',' ORDER BY line)) FROM (SELECT row::text AS line FROM ({}) row)"
        )
        return {name: self.ask(lines.format(query)) for name, query in DERIVED.items()}

    def tokens(self) -> list[str]:
        """Of CLIENTS new installations."""
        wish = {"app": "test", "app_version": "0.1.0", "consent_version": 2}
        with Web(self.var, self.services) as web:
            answers = [Connection(web.port).post("/api/v1/enrol", wish) for _ in range(CLIENTS)]
        return [answer["token"] for answer in answers]

    def take(self, tokens: Sequence[str], count: int, processes: int = 1) -> dict[str, float]:
        """What `count` submissions cost, and which bytes they write."""
        with Web(self.var, self.services, processes=processes) as web:
            pids = [web.process.pid, self.server.process.pid]

            def send(count: int) -> dict[str, float]:
                return ingest(web.port, tokens, count, lambda: cpu_seconds(pids), devices=NAMES)

            send(CLIENTS * 4 * processes)  # warms up
            self.do("CHECKPOINT")
            before = self._written()
            sent = send(count)
            written, images = (now - was for now, was in zip(self._written(), before, strict=True))
        return sent | {"kb": round(written / count / 1e3, 1), "images": round(images / count, 1)}

    def _written(self) -> tuple[int, int]:
        """Bytes of the write-ahead log so far, and images of whole pages in it."""
        log = "pg_current_wal_lsn() - '0/0'"
        return int(self.ask(f"SELECT {log}")), int(self.ask("SELECT wal_fpi FROM pg_stat_wal"))

    def statements(self, tokens: Sequence[str]) -> float:
        """How many a submission executes, transactions' own among them."""
        name = self.url.rpartition("/")[2]
        self.do(f"ALTER DATABASE {name} SET log_min_duration_statement = 0")
        with Web(self.var, self.services) as web:
            ingest(web.port, tokens, CLIENTS * 8, lambda: 0.0, devices=NAMES)  # prepares statements
            before = self._logged()
            ingest(web.port, tokens, TRACED, lambda: 0.0, devices=NAMES)
            found = (self._logged() - before) / TRACED
        self.do(f"ALTER DATABASE {name} RESET log_min_duration_statement")
        return found

    def _logged(self) -> int:
        return len(re.findall(rb"ms  (?:statement|execute)", self.server.log.read_bytes()))

    def summarise(self) -> dict[str, float]:
        """CPU for summarising what waits, one session after another: of the worker and of the database."""
        before = cpu_seconds([self.server.process.pid])
        sessions, worker = json.loads(shell(self.var, SUMMARISE, **self.services).splitlines()[-1])
        database = cpu_seconds([self.server.process.pid]) - before
        return {
            "worker_cpu_ms": round(1e3 * worker / sessions, 2),
            "database_cpu_ms": round(1e3 * database / sessions, 2),
        }


def _in_turns(places: dict[str, Place], say: Callable[[str], Any]) -> dict[str, Any]:
    """Intake in each of `places`, ROUNDS times in turns: every round, and its medians."""
    rounds: dict[str, list[dict[str, float]]] = {size: [] for size in places}
    tokens = {size: place.tokens() for size, place in places.items()}
    for _ in range(ROUNDS):
        for size, place in places.items():
            rounds[size].append(place.take(tokens[size], SUBMISSIONS) | place.summarise())
            say(f"{size:>10} {rounds[size][-1]}")
    found: dict[str, Any] = {
        size: {name: median(each[name] for each in rows) for name in rows[0]} for size, rows in rounds.items()
    }
    for size, place in places.items():
        found[size]["statements"] = place.statements(tokens[size])
    small, large = found.values()
    ratios = {name: round(large[name] / small[name], 2) for name in small}
    say(f"medians: {found}, ratios: {ratios}")
    return found | {"ratios": ratios, "rounds": rounds}


def _rates(place: Place) -> dict[str, float]:
    """Submissions a second with one web process and with two, client included, in turns; and their ratio."""
    tokens = place.tokens()
    rates: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(ROUNDS):
        for processes, found in rates.items():
            found.append(place.take(tokens, SUBMISSIONS, processes)["submissions_per_second"])
    one, two = (median(found) for found in rates.values())
    return {"one": one, "two": two, "ratio": round(two / one, 2)}
