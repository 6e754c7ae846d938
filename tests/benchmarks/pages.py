"""python -m tests.benchmarks.pages URL URL: how long two servers take for each page, before and now.

The servers, of two versions with data of the same kind, answer one request after another in turns. A page of
a device, a front, an exploration is the first one that the list links. The ratios compare in one run only, as
other programs slow both alike.
"""

from __future__ import annotations

import argparse
import re
import urllib.parse

from tests.benchmarks.crowd_load import THREADS, Connection, milliseconds

ROUNDS = 100
PAGES = ("/", "/devices/", "/fronts/", "/explorations/", "/compare/", "/transfer/", "/recommend/")
# The first page that a list links.
LINKED = {"/devices/": "devices", "/fronts/": "fronts", "/explorations/": "explorations"}
API = ("/api/v1/devices", "/api/v1/speedups", "/api/v1/sessions", "/api/v1/runs", "/api/v1/fronts")


class Server:
    """One server with its kept connection."""

    def __init__(self, url: str) -> None:
        self.connection = Connection(urllib.parse.urlsplit(url).port or 80)
        self.linked = {kind: self._first(path, kind) for path, kind in LINKED.items()}

    def _first(self, path: str, kind: str) -> str:
        self.connection.http.request("GET", path)
        text = self.connection.http.getresponse().read().decode()
        found = re.search(rf'href="(/{kind}/[\w.-]+/)"', text)
        assert found, f"{path} links no page of {kind}"
        return found[1]

    def seconds(self, path: str) -> float:
        """How long the server takes for `path`, or for the page that its list links."""
        status, seconds, _ = self.connection.ask("GET", self.linked.get(path, path))
        assert status == 200, f"{path}: {status}"
        return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before")
    parser.add_argument("now")
    options = parser.parse_args()
    before, now = Server(options.before), Server(options.now)
    print(f"| {'page':18} | p50 ms, before | now | ratio | p95 ms, before | now | ratio |")
    print("|---|---|---|---|---|---|---|")
    for path in (*PAGES, *LINKED.values(), *API):
        for _ in range(THREADS):
            before.seconds(path), now.seconds(path)
        times = [(before.seconds(path), now.seconds(path)) for _ in range(ROUNDS)]
        was, found = (milliseconds(each) for each in zip(*times, strict=True))
        columns = [
            f"{was[name]:.0f} | {found[name]:.0f} | {found[name] / was[name]:.2f}"
            for name in ("p50_ms", "p95_ms")
        ]
        print(f"| {path:18} | {' | '.join(columns)} |", flush=True)


if __name__ == "__main__":
    main()
