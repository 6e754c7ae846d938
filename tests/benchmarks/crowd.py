"""How much one machine takes in, beside a plain implementation, and what it costs as the crowd grows.

python -m tests.benchmarks.crowd [--quick] [--only PART ...] [--databases NAME ...] [--base REV]; parts:
- intake: submissions of four runs by four clients at once, on granian alone, beside the peer in
  `tests.benchmarks.plain` on the same database, in turns; and the manifest's 304.
- growth: the same questions and one more submission at 10,000, 100,000 and 1,000,000 runs (`crowd_growth`);
  --quick: up to 20,000.
- flood: 400 submissions, then 1,000 downloads at one moment (`crowd_flood`).
- explorations: what an evaluation costs besides its measurement (`crowd_explorations`); not with --quick.
- watching: how long a large exploration's pages take (`crowd_watching`); not with --quick.

Before intake and growth, the benchmark of the commit REV measures the same by its own program. A last table
has both side by side, and what bounds them: a submission that is read but not stored, a page of text, and for
the API one word.

All on SQLite and, where its wheel is installed, on PostgreSQL. Intake and growth can be asked for one of them
alone. Writes var/benchmarks/crowd.json, where what was not measured
this time stays, and prints tables. Figures of one run compare with each other: clients, server and database
share this machine's cores.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.benchmarks import (
    crowd_explorations,
    crowd_flood,
    crowd_growth,
    crowd_watching,
    sequences,
)
from tests.benchmarks.crowd_explorations import cpu_seconds, loop_seconds
from tests.benchmarks.crowd_load import CLIENTS, Web, ingest, unchanged
from tests.services.intake import prepare
from tests.services.postgresql import PostgreSQL
from tests.services.program import ROOT
from tests.services.serving import Services, Serving, command

PARTS = ("intake", "growth", "flood", "explorations", "watching")
DATABASES = ("sqlite", "postgresql")
PEER = {
    "application": "tests.benchmarks.plain.wsgi:application",
    "settings": "tests.benchmarks.plain.settings",
}
TURNS = 3
SUBMISSIONS, MANIFESTS = 400, 2000
# What the last table shows of each read.
FIGURES = (
    ("warm", "server_cpu_ms", "CPU ms"),
    ("warm", "p95_ms", "p95 ms"),
    ("cold", "slowest_ms", "first, ms"),
)
RESULTS = Path(os.environ.get("FRONTRUNNER_VAR", ROOT / "var")) / "benchmarks" / "crowd.json"


@contextmanager
def databases(names: Sequence[str]) -> Iterator[dict[str, PostgreSQL | None]]:
    """Those of `names` that are here: SQLite (None) and, where it is installed, an empty PostgreSQL."""
    available: dict[str, PostgreSQL | None] = {"sqlite": None} if "sqlite" in names else {}
    if "postgresql" not in names:
        yield available
        return
    try:
        server = PostgreSQL()
    except ImportError:
        yield available
        return
    with server:
        yield available | {"postgresql": server}


def environment_of(database: PostgreSQL | None) -> Services:
    return {} if database is None else {"DATABASE_URL": database.url}


def intake(var: Path, database: PostgreSQL | None, share: float) -> dict[str, Any]:
    """Ours and the peer in turns, each TURNS times; medians by submissions a second."""
    services = environment_of(database)
    prepare(var, services)
    done = command(
        var, "migrate", "--run-syncdb", **services, DJANGO_SETTINGS_MODULE="tests.benchmarks.plain.settings"
    )
    assert done.returncode == 0, done.stderr
    with Serving(var, services | {"FRONTRUNNER_LIMITS": "0"}) as server:
        tokens = [server.enrol() for _ in range(CLIENTS)]
    rounds: dict[str, list[dict[str, float]]] = {"ours": [], "plain": []}
    manifests, bounds = [], []
    for _ in range(TURNS):
        for name, web in (("ours", Web(var, services)), ("plain", Web(var, services, **PEER))):
            with web:
                pids = [web.process.pid, *([database.process.pid] if database else [])]

                def cpu(pids: list[int] = pids) -> float:
                    return cpu_seconds(pids)

                ingest(web.port, tokens, CLIENTS * 4, cpu)  # warms up
                rounds[name].append(ingest(web.port, tokens, int(SUBMISSIONS * share), cpu))
                if name == "plain":
                    bounds.append(ingest(web.port, tokens, int(SUBMISSIONS * share), cpu, "/parse-only"))
                if name == "ours":
                    path = "/api/v1/manifest?application=kfusion"
                    manifests.append(unchanged(web.port, path, int(MANIFESTS * share), cpu))
    medians: dict[str, Any] = {
        name: sorted(each, key=lambda row: row["submissions_per_second"])[TURNS // 2]
        for name, each in rounds.items()
    }
    ours, plain = medians["ours"], medians["plain"]
    return medians | {
        "ratio": round(ours["submissions_per_second"] / plain["submissions_per_second"], 2),
        "bound": sorted(bounds, key=lambda row: row["server_cpu_ms"])[TURNS // 2],
        "cpu_ratio": round(plain["server_cpu_ms"] / ours["server_cpu_ms"], 2),
        "manifest_304": sorted(manifests, key=lambda row: row["requests_per_second"])[TURNS // 2],
        "rounds": rounds,
    }


def measure_before(base: str, options: argparse.Namespace, parts: Sequence[str]) -> dict[str, Any]:
    """What the benchmark of the commit `base` finds of `parts`, by its own program on its own databases."""
    command = [sys.executable, "-m", "tests.benchmarks.crowd", "--only", *parts]
    command += ["--databases", *options.databases, *(["--quick"] if options.quick else [])]
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"FRONTRUNNER_VAR": folder}
        subprocess.run(command, cwd=sequences.checkout(base), env=environment, check=True)
        results: dict[str, Any] = json.loads((Path(folder) / "benchmarks" / "crowd.json").read_text())
    return {part: results[part] for part in parts}


def table(before: dict[str, Any], now: dict[str, Any]) -> Iterator[str]:
    """Lines with the figures of both, of each database, and what bounds them."""

    def line(name: str, *figures: float | str) -> str:
        return f"{name:34}" + "".join(f"{figure:>10}" for figure in figures)

    for database, row in now.get("intake", {}).items():
        yield ""
        yield line(f"{database}: intake, CPU ms", "before", "now", "plain", "bound")
        was = before["intake"][database]["ours"]["server_cpu_ms"]
        yield line("one submission", was, *(row[who]["server_cpu_ms"] for who in ("ours", "plain", "bound")))
    for database, sizes in now.get("growth", {}).items():
        size, row = list(sizes.items())[-1]
        was = before["growth"][database][size]
        yield ""
        yield line(f"{database}: {size} runs", "before", "now", "bound")
        for key, who in (("web_cpu_ms", "web server"), ("worker_cpu_ms", "worker")):
            yield line(f"one more, {who}, CPU ms", was["one_more"][key], row["one_more"][key])
        for kind, figure, what in FIGURES:
            for name, path in crowd_growth.READS.items():
                if path not in crowd_growth.BOUNDS.values():
                    figures = (each[kind][name][figure] for each in (was, row))
                    bound = row[kind][crowd_growth.bound_of(path)][figure]
                    yield line(f"{name}, {what}", *figures, bound)
        yield line("chart of all devices, kB gzipped", was.get("chart_kb", "-"), row["chart_kb"])


def _intake(say: Callable[[str], Any], quick: bool, names: Sequence[str]) -> dict[str, Any]:
    say(f"Submissions of four runs, {CLIENTS} clients (server's CPU with its database's)")
    say(
        f"{'':12} {'ours /s':>9} {'p95 ms':>8} {'CPU ms':>8} {'plain /s':>9} {'p95 ms':>8} {'CPU ms':>8} "
        f"{'ratio':>6} {'of CPU':>7} {'304 /s':>8} {'p95 ms':>7}"
    )
    results: dict[str, Any] = {}
    with databases(names) as each:
        for name, database in each.items():
            with tempfile.TemporaryDirectory() as folder:
                results[name] = row = intake(Path(folder) / "var", database, 0.25 if quick else 1.0)
            figures = "".join(_columns(row[who]) for who in ("ours", "plain"))
            same = row["manifest_304"]
            say(
                f"{name:12}{figures} {row['ratio']:>6} {row['cpu_ratio']:>7} "
                f"{same['requests_per_second']:>8} {same['p95_ms']:>7}"
            )
    return results


def _columns(row: dict[str, float]) -> str:
    return f" {row['submissions_per_second']:>9} {row['p95_ms']:>8} {row['server_cpu_ms']:>8}"


def _growth(say: Callable[[str], Any], quick: bool, names: Sequence[str]) -> dict[str, Any]:
    plan = crowd_growth.QUICK if quick else crowd_growth.FULL
    results: dict[str, Any] = {}
    with databases(names) as each:
        for name, database in each.items():
            say(f"Growth on {name}, {plan.devices} devices")
            say(crowd_growth.heading())
            with tempfile.TemporaryDirectory() as folder:
                results[name] = crowd_growth.measure(Path(folder), plan, database, say)
    return results


def main() -> None:
    def say(line: str) -> None:
        print(line, flush=True)

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a minute or two, for those who change the code")
    parser.add_argument("--only", nargs="+", choices=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument(
        "--databases",
        nargs="+",
        choices=DATABASES,
        default=DATABASES,
        metavar="NAME",
        help=", ".join(DATABASES),
    )
    parser.add_argument("--base", metavar="REV", default="HEAD", help="the commit before (HEAD)")
    options = parser.parse_args()
    parts = options.only or (PARTS[:3] if options.quick else PARTS)
    results: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    results |= {"quick": options.quick, "cores": os.cpu_count(), "loop_s": round(loop_seconds(), 3)}
    with_base = [part for part in ("intake", "growth") if part in parts]
    before = measure_before(options.base, options, with_base) if with_base else {}
    if "intake" in parts:
        _keep(results, "intake", _intake(say, options.quick, options.databases))
    if "growth" in parts:
        _keep(results, "growth", _growth(say, options.quick, options.databases))
    if "flood" in parts:
        _keep(results, "flood", crowd_flood.measure(say))
    if "explorations" in parts:
        _keep(results, "explorations", crowd_explorations.compare(say))
    if "watching" in parts:
        _keep(results, "watching", crowd_watching.compare(say))
    if with_base:
        results["before"] = {}
        _keep(results, "before", before | {"commit": options.base})
        now = {part: {name: results[part][name] for name in before[part]} for part in with_base}
        say("\n".join(table(before, now)))
    say(f"Written: {RESULTS}")


def _keep(results: dict[str, Any], part: str, figures: dict[str, Any]) -> None:
    """Write the `figures` of a `part`, beside what is there of others: a later part may take an hour."""
    results[part] = results.get(part, {}) | figures
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
