"""How much one machine takes in: python -m tests.benchmarks.crowd.

A real `manage.py serve` on each database, a few clients that submit made-up sessions of four runs as fast
as they are answered, and the manifest asked for again and again; then what an evaluation of an exploration
costs on each broker. Writes var/benchmarks/crowd.json and prints tables.
"""

import gzip
import http.client
import json
import os
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks import crowd_explorations
from tests.crowd.documents import (
    device_document,
    front_document,
    session_document,
    submission_document,
    write_pack,
)
from tests.services.postgresql import PostgreSQL
from tests.services.program import ROOT, until
from tests.services.serving import Services, Serving, command

CLIENTS = 4
SUBMISSIONS = 400
MANIFESTS = 1000
RESULTS = Path(os.environ.get("FRONTRUNNER_VAR", ROOT / "var")) / "benchmarks" / "crowd.json"


def milliseconds(seconds: list[float]) -> dict[str, float]:
    """Median and 95th percentile."""
    p50, p95 = np.percentile(np.array(seconds) * 1e3, [50, 95])
    return {"p50_ms": round(float(p50), 2), "p95_ms": round(float(p95), 2)}


class Connection:
    """One client's kept connection."""

    def __init__(self, server: Serving) -> None:
        self.http = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)

    def ask(
        self, method: str, path: str, body: bytes | None = None, **headers: str
    ) -> tuple[int, float, Any]:
        """Status, seconds and headers of one request."""
        begun = time.perf_counter()
        self.http.request(method, path, body, headers)
        response = self.http.getresponse()
        response.read()
        return response.status, time.perf_counter() - begun, response.headers


def bodies(count: int) -> list[bytes]:
    """Gzipped submissions of four runs with realistic noise, from 50 made-up models."""
    random = np.random.default_rng(0)
    made = []
    for number in range(count):
        session = session_document()
        for run in session["runs"]:
            times = random.normal(run["frame_us"][0], run["frame_us"][0] * 0.03, 100).astype(int)
            run["frame_us"] = times.tolist()
            run["stages_us"] = {
                name: (times * share).astype(int).tolist()
                for name, share in {
                    "preprocessing": 0.1,
                    "tracking": 0.2,
                    "integration": 0.2,
                    "raycasting": 0.5,
                }.items()
            }
        document = submission_document(session, device=device_document(f"Model {number % 50}"))
        made.append(gzip.compress(json.dumps(document).encode()))
    return made


def ingest(server: Serving) -> dict[str, float]:
    """Submissions a second with CLIENTS clients at once, each on its own kept connection."""
    work = [bodies(SUBMISSIONS // CLIENTS) for _ in range(CLIENTS)]
    tokens = [server.enrol() for _ in range(CLIENTS)]
    times: list[list[float]] = [[] for _ in range(CLIENTS)]

    def participate(number: int) -> None:
        connection = Connection(server)
        for body in work[number]:
            status, seconds, _ = connection.ask(
                "POST",
                "/api/v1/submissions",
                body,
                **{
                    "Content-Type": "application/json",
                    "Content-Encoding": "gzip",
                    "Authorization": f"Bearer {tokens[number]}",
                    "Idempotency-Key": str(uuid.uuid4()),
                },
            )
            assert status == 202, status
            times[number].append(seconds)

    clients = [threading.Thread(target=participate, args=(number,)) for number in range(CLIENTS)]
    begun = time.perf_counter()
    for client in clients:
        client.start()
    for client in clients:
        client.join()
    taken = time.perf_counter() - begun
    until(lambda: server.waiting() == 0, 300)
    return {
        "submissions_per_second": round(SUBMISSIONS / taken, 1),
        **milliseconds([seconds for each in times for seconds in each]),
        "summarised_after_s": round(time.perf_counter() - begun - taken, 2),
    }


def unchanged(server: Serving, path: str) -> dict[str, float]:
    """The 304 of the manifest, one request after another on a kept connection."""
    connection = Connection(server)
    _, _, headers = connection.ask("GET", path)
    times = []
    for _ in range(MANIFESTS):
        status, seconds, _ = connection.ask("GET", path, **{"If-None-Match": headers["ETag"]})
        assert status == 304, status
        times.append(seconds)
    return {"requests_per_second": round(MANIFESTS / sum(times), 1), **milliseconds(times)}


def read(server: Serving, path: str) -> dict[str, float]:
    """A public read, 50 times on a kept connection."""
    connection = Connection(server)
    times = [connection.ask("GET", path)[1] for _ in range(50)]
    return milliseconds(times)


def measure(services: Services) -> dict[str, Any]:
    """All figures on one database, in a data folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        var = Path(folder) / "var"
        front = Path(folder) / "front.json"
        front.write_text(json.dumps(front_document(write_pack(var / "sequences"))))
        for arguments in (("migrate",), ("publish_front", str(front))):
            done = command(var, *arguments, **services)
            assert done.returncode == 0, done.stderr
        limits = {"FRONTRUNNER_SUBMISSIONS_PER_MINUTE": "1000000"}
        with Serving(var, services | limits) as server:
            return {
                "ingest": ingest(server),
                "manifest_304": unchanged(server, "/api/v1/manifest?application=kfusion"),
                "speedups": read(server, "/api/v1/speedups"),
                "device": read(server, "/api/v1/devices/google-model-1"),
            }


def intake() -> dict[str, Any]:
    """The figures of the intake on each database, None where one is not installed."""
    found: dict[str, Any] = {"sqlite": measure({})}
    try:
        with PostgreSQL() as database:
            found["postgresql"] = measure({"DATABASE_URL": database.url})
    except ImportError:
        found["postgresql"] = None
    return found


def main(say: Callable[[str], Any] = lambda line: sys.stdout.write(f"{line}\n")) -> None:
    results: dict[str, Any] = {"clients": CLIENTS, "submissions": SUBMISSIONS, "runs_a_submission": 4}
    results |= intake()
    say(f"{'':12} {'submissions/s':>14} {'p95 ms':>8} {'304/s':>8} {'p95 ms':>8} {'speedups p95 ms':>16}")
    for name in ("sqlite", "postgresql"):
        row = results[name]
        if row is None:
            say(f"{name:12} its wheel is not installed")
            continue
        say(
            f"{name:12} {row['ingest']['submissions_per_second']:>14} {row['ingest']['p95_ms']:>8} "
            f"{row['manifest_304']['requests_per_second']:>8} {row['manifest_304']['p95_ms']:>8} "
            f"{row['speedups']['p95_ms']:>16}"
        )
    results["explorations"] = crowd_explorations.compare(say)
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=2))
    say(f"Written: {RESULTS}")


if __name__ == "__main__":
    main()
