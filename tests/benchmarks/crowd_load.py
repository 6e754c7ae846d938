"""Clients of a server under measurement: what they send and ask, how fast it is answered, at which CPU."""

import gzip
import http.client
import json
import os
import sys
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd.operations import web_server
from tests.builders.documents import device_document, session_document, submission_document
from tests.services.intake import LIMITS, SUBMISSIONS
from tests.services.program import ROOT, Program, free_port
from tests.services.serving import Services, environment

CLIENTS = 4
THREADS = 4  # of the server, as `manage.py serve` has them
STAGES = {"preprocessing": 0.1, "tracking": 0.2, "integration": 0.2, "raycasting": 0.5}


class Web(Program):
    """granian alone, as `manage.py serve` starts it, or with another WSGI `application`; no worker runs."""

    def __init__(
        self,
        var: Path,
        services: Services,
        application: str = web_server.APPLICATION,
        settings: str = "crowd.settings",
    ) -> None:
        self.var, self.services, self.application, self.settings = var, services, application, settings
        self.port, self.folder, self.log = free_port(), ROOT, var / "web.txt"

    def command(self) -> Sequence[str]:
        if self.application == web_server.APPLICATION:
            return web_server.command("127.0.0.1", self.port, "--workers", "1")
        return [
            *(sys.executable, "-m", "granian", "--interface", "wsgi", "--host", "127.0.0.1"),
            *("--port", str(self.port), "--workers", "1", "--blocking-threads", str(THREADS)),
            *("--no-ws", "--log-level", "warning", self.application),
        ]

    def environment(self) -> Mapping[str, str]:
        return environment(self.var, **LIMITS | self.services, DJANGO_SETTINGS_MODULE=self.settings)

    def ready(self) -> bool:
        try:
            return Connection(self.port).ask("GET", "/healthz")[0] == 200
        except OSError:
            return False


class Connection:
    """One client's kept connection."""

    def __init__(self, port: int) -> None:
        self.http = http.client.HTTPConnection("127.0.0.1", port, timeout=120)

    def ask(
        self, method: str, path: str, body: bytes | None = None, **headers: str
    ) -> tuple[int, float, Any]:
        """Status, seconds and headers of one request."""
        begun = time.perf_counter()
        self.http.request(method, path, body, headers)
        response = self.http.getresponse()
        response.read()
        return response.status, time.perf_counter() - begun, response.headers

    def submit(self, token: str, body: bytes, path: str = SUBMISSIONS) -> float:
        """Seconds until `body`, gzipped, was accepted."""
        status, seconds, _ = self.ask(
            "POST",
            path,
            body,
            **{
                "Content-Type": "application/json",
                "Content-Encoding": "gzip",
                "Authorization": f"Bearer {token}",
                "Idempotency-Key": str(uuid.uuid4()),
            },
        )
        assert status == 202, status
        return seconds


def bodies(count: int, device: Callable[[int], dict[str, Any]] | None = None) -> list[bytes]:
    """Gzipped submissions of four runs with realistic noise, of one device or of those that `device` gives.

    No two have the same times: the second would be a copy.
    """
    random = np.random.default_rng()
    made = []
    for number in range(count):
        session = session_document()
        for run in session["runs"]:
            times = random.normal(run["frame_us"][0], run["frame_us"][0] * 0.03, 100).astype(int)
            run["frame_us"] = times.tolist()
            run["stages_us"] = {name: (times * share).astype(int).tolist() for name, share in STAGES.items()}
        described = device(number) if device else device_document("Pixel 8")
        made.append(gzip.compress(json.dumps(submission_document(session, device=described)).encode()))
    return made


def milliseconds(seconds: Sequence[float]) -> dict[str, float]:
    """Median and 95th percentile."""
    p50, p95 = np.percentile(np.array(seconds) * 1e3, [50, 95])
    return {"p50_ms": round(float(p50), 2), "p95_ms": round(float(p95), 2)}


def ingest(
    port: int,
    tokens: Sequence[str],
    count: int,
    cpu: Callable[[], float],
    path: str = SUBMISSIONS,
) -> dict[str, float]:
    """`count` submissions of as many clients at once as there are `tokens`, each on its own connection."""
    work = [bodies(count // len(tokens)) for _ in tokens]
    times: list[list[float]] = [[] for _ in tokens]

    def participate(number: int) -> None:
        connection = Connection(port)
        for body in work[number]:
            times[number].append(connection.submit(tokens[number], body, path))

    clients = [threading.Thread(target=participate, args=(number,)) for number in range(len(tokens))]
    before, begun = cpu(), time.perf_counter()
    for client in clients:
        client.start()
    for client in clients:
        client.join()
    taken, spent = time.perf_counter() - begun, cpu() - before
    answered = [seconds for each in times for seconds in each]
    assert len(answered) == len(tokens) * len(work[0]), "a client failed"
    return {
        "submissions_per_second": round(len(answered) / taken, 1),
        **milliseconds(answered),
        "server_cpu_ms": round(1e3 * spent / len(answered), 2),
    }


def unchanged(port: int, path: str, count: int, cpu: Callable[[], float]) -> dict[str, float]:
    """The 304 of `path`, one request after another on a kept connection."""
    connection = Connection(port)
    _, _, headers = connection.ask("GET", path)
    times, before = [], cpu()
    for _ in range(count):
        status, seconds, _ = connection.ask("GET", path, **{"If-None-Match": headers["ETag"]})
        assert status == 304, status
        times.append(seconds)
    return {
        "requests_per_second": round(count / sum(times), 1),
        **milliseconds(times),
        "server_cpu_ms": round(1e3 * (cpu() - before) / count, 3),
    }


def read(port: int, path: str, cpu: Callable[[], float], count: int = 50) -> dict[str, float]:
    """A public read, after as many as the server has THREADS, which may each have to warm up."""
    connection = Connection(port)

    def ask() -> float:
        status, seconds, _ = connection.ask("GET", path)
        assert status == 200, f"{path}: {status}"
        return seconds

    first, *_ = [ask() for _ in range(THREADS)]
    before = cpu()
    times = [ask() for _ in range(count)]
    return {
        "first_ms": round(first * 1e3, 1),
        **milliseconds(times),
        "server_cpu_ms": round(1e3 * (cpu() - before) / count, 2),
    }


def forget(folder: Path) -> None:
    """Have the system drop what it keeps in memory of the files below `folder`. POSIX alone can."""
    for path in folder.rglob("*"):
        if path.is_file():
            descriptor = os.open(path, os.O_RDONLY)
            try:
                os.fsync(descriptor)
                os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
            finally:
                os.close(descriptor)
