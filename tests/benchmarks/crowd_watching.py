"""How long a viewer of a large exploration waits: its page, its live part, its figures, the API.

Ten thousand measurements on the embedded default, asked for one after another on a kept connection: what is
told again (`warm`), and the first answers after another measurement has come (`changed`). Part of
`python -m tests.benchmarks.crowd`; alone: python -m tests.benchmarks.crowd_watching.
"""

import http.client
import sqlite3
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from tests.benchmarks.crowd_load import milliseconds
from tests.services import exploring
from tests.services.serving import Serving, command

MEASUREMENTS = 10_000
CHANGES = 20
ASKED = 40
PATHS = {
    "page": "/explorations/{key}/",
    "live part": "/explorations/{key}/live/",
    "API": "/api/v1/explorations/{key}",
    "scatter": "/figures/explorations/{key}.json",
    "hypervolume": "/figures/explorations/{key}/hypervolume.json",
    "importance": "/figures/explorations/{key}/importance.json",
    "predictions": "/figures/explorations/{key}/predictions/runtime.json",
}
MEASURED = """
    UPDATE explorations_evaluation SET state = 'done', started_at = ?1, finished_at = ?1, attempt = 1,
        objectives = (SELECT objectives FROM explorations_evaluation WHERE number = 1)
    WHERE id = (SELECT min(id) FROM explorations_evaluation WHERE state = 'pending')
"""


def measure() -> dict[str, dict[str, float]]:
    """Milliseconds by what is asked for: median and 95th percentile, warm and after a change."""
    with tempfile.TemporaryDirectory() as folder:
        var = Path(folder) / "var"
        services = exploring.SETTINGS | {"FRONTRUNNER_LIMITS": "0"}
        done = command(var, "migrate", **services)
        assert done.returncode == 0, done.stderr
        key = exploring.start_large(var, services, MEASUREMENTS, MEASUREMENTS + CHANGES * len(PATHS))
        with Serving(var, services) as server:
            paths = {name: path.format(key=key) for name, path in PATHS.items()}
            return {name: _times(server, var, path) for name, path in paths.items()}


def _times(server: Serving, var: Path, path: str) -> dict[str, float]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)

    def seconds() -> float:
        begun = time.perf_counter()
        connection.request("GET", path)
        response = connection.getresponse()
        body = response.read()
        assert response.status == 200, body
        return time.perf_counter() - begun

    seconds()  # what is kept from now on
    warm = [seconds() for _ in range(ASKED)]
    changed = []
    for _ in range(CHANGES):
        with closing(sqlite3.connect(var / "frontrunner.sqlite3", timeout=20)) as database, database:
            database.execute(MEASURED, [time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())])
        changed.append(seconds())
    connection.close()
    return {
        f"{name}_{figure}": value
        for name, seconds in (("warm", warm), ("changed", changed))
        for figure, value in milliseconds(seconds).items()
    }


def compare(say: Callable[[str], Any]) -> dict[str, dict[str, float]]:
    """The figures of everything that is asked for."""
    found = measure()
    say(f"Watching {MEASUREMENTS} measurements, ms")
    say(" " * 14 + "".join(f"{column:>14}" for column in ("warm p50", "p95", "changed p50", "p95")))
    for name, row in found.items():
        say(f"{name:14}" + "".join(f"{value:>14}" for value in row.values()))
    return found


if __name__ == "__main__":
    compare(lambda line: print(line, flush=True))
