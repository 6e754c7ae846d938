"""python -m tests.benchmarks.pages URL URL: how long two servers take for each page, before and now.

The servers, of two versions with data of the same kind, run on this machine and answer one request after
another in turns. Start both with FRONTRUNNER_LIMITS=0 in the environment: otherwise an address may read 600
pages a minute. A page of a device, a front, an exploration is the first one that the list links. The ratios
compare in one run only, those of CPU (medians) also on a busy machine.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import time
import urllib.parse
from collections.abc import Iterable
from http.client import HTTPConnection
from statistics import median

from tests.benchmarks.crowd_load import THREADS, Connection, milliseconds

PAGES = ("/", "/devices/", "/fronts/", "/explorations/", "/compare/", "/transfer/", "/recommend/")
# The first page that a list links.
LINKED = {"/devices/": "devices", "/fronts/": "fronts", "/explorations/": "explorations"}
API = ("/api/v1/devices", "/api/v1/speedups", "/api/v1/sessions", "/api/v1/runs", "/api/v1/fronts")


class Server:
    """A web server of this machine."""

    def __init__(self, url: str) -> None:
        self.port = urllib.parse.urlsplit(url).port or 80
        listed = subprocess.run(
            ["ps", "-A", "-ww", "-o", "pid=,command="], capture_output=True, text=True, check=True
        )
        lines = [line.split(None, 1) for line in listed.stdout.splitlines()]
        self.pids = [int(pid) for pid, line in lines if "granian" in line and f"--port {self.port} " in line]
        assert self.pids, f"no web server of this machine is at {url}"
        self.linked = {kind: self._first(path, kind) for path, kind in LINKED.items()}

    def _first(self, path: str, kind: str) -> str:
        connection = HTTPConnection("127.0.0.1", self.port)
        connection.request("GET", path)
        answer = connection.getresponse()
        self._expect_page(path, answer.status)
        text = answer.read().decode()
        found = re.search(rf'href="(/{kind}/[\w.-]+/)"', text)
        assert found, f"{path} links no page of {kind}"
        return found[1]

    def seconds(self, path: str) -> float:
        """How long the server takes for `path`, or for the page that its list links."""
        status, seconds, _ = Connection(self.port).ask("GET", self.linked.get(path, path))
        self._expect_page(path, status)
        return seconds

    def _expect_page(self, path: str, status: int) -> None:
        if status == 429:
            raise SystemExit(
                f"{path}: the server on port {self.port} limits how many pages an address may read (429): "
                "start both servers with FRONTRUNNER_LIMITS=0"
            )
        assert status == 200, f"{path}: {status}"


def cpu_of(pids: Iterable[int]) -> float:
    """CPU seconds of the processes `pids`, by the clock that Linux has for each (clock_getcpuclockid)."""
    return sum(time.clock_gettime(~pid << 3 | 2) for pid in pids)


def times(server: Server, path: str) -> tuple[float, float]:
    """Seconds and CPU seconds of one answer."""
    before = cpu_of(server.pids)
    seconds = server.seconds(path)
    return seconds, cpu_of(server.pids) - before


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before")
    parser.add_argument("now")
    parser.add_argument("--rounds", type=int, default=100, help="requests of each page (100)")
    options = parser.parse_args()
    servers = Server(options.before), Server(options.now)
    print("| page | p50 ms, before | now | p95 ms, before | now | ratio | CPU ms, before | now | ratio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for path in (*PAGES, *LINKED.values(), *API):
        for _ in range(THREADS):
            [server.seconds(path) for server in servers]
        rounds = [[times(server, path) for server in servers] for _ in range(options.rounds)]
        seconds, cpu = zip(*(zip(*each, strict=True) for each in zip(*rounds, strict=True)), strict=True)
        was, found = (milliseconds(each) for each in seconds)
        spent = [1e3 * median(each) for each in cpu]
        print(
            f"| {path:18} | {was['p50_ms']:.0f} | {found['p50_ms']:.0f} | {was['p95_ms']:.0f} "
            f"| {found['p95_ms']:.0f} | {found['p95_ms'] / was['p95_ms']:.2f} "
            f"| {spent[0]:.1f} | {spent[1]:.1f} | {spent[1] / spent[0]:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
