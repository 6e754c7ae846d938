"""What many clients at one moment cost a server: the longest wait for /healthz, and memory."""

import tempfile
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.benchmarks.crowd_load import THREADS, Connection, Web, bodies
from tests.services.intake import SUBMISSIONS, prepare
from tests.services.program import family
from tests.services.serving import Serving
from tests.waiting import until

POSTS, DOWNLOADS = 400, 1000
PAUSE_SECONDS = 0.02


def measure(say: Callable[[str], Any]) -> dict[str, Any]:
    """POSTS submissions at one moment, then DOWNLOADS of one chunk, on SQLite."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        var = Path(folder) / "var"
        prepare(var, {})
        chunk = next((var / "sequences").glob("*/chunks/*")).name
        with Serving(var, {}) as server:
            token = server.enrol()
        (body,) = bodies(1)
        headers = {"Authorization": f"Bearer {token}", "Content-Encoding": "gzip"}
        headers |= {"Content-Type": "application/json"}
        for name, count, request in (
            (f"{POSTS} submissions", POSTS, ("POST", SUBMISSIONS, body)),
            (f"{DOWNLOADS} downloads", DOWNLOADS, ("GET", f"/sequences/{chunk}", None)),
        ):
            with Web(var, {}) as web:
                found[name] = row = _flood(web, count, request, headers)
            waited = f"/healthz took {row['healthz_s']} s at most"
            say(f"{name}: {waited}, memory {row['grown_mb']:+} MB, answers {row['statuses']}")
    return found


def _flood(
    web: Web, count: int, request: tuple[str, str, bytes | None], headers: dict[str, str]
) -> dict[str, Any]:
    statuses: Counter[int] = Counter()
    together = threading.Barrier(count + 1)

    def ask(number: int) -> None:
        connection = Connection(web.port)
        together.wait()
        status, *_ = connection.ask(*request, **headers, **{"Idempotency-Key": str(number)})
        statuses[status] += 1

    clients = [threading.Thread(target=ask, args=(number,)) for number in range(count)]
    for number in range(THREADS):  # each may have to warm up
        Connection(web.port).ask(*request, **headers, **{"Idempotency-Key": f"warm {number}"})
    for client in clients:
        client.start()
    before, seconds, megabytes = _megabytes(web), [0.0], [0.0]

    def answered() -> bool:
        seconds.append(Connection(web.port).ask("GET", "/healthz")[1])
        megabytes.append(_megabytes(web))
        return not any(client.is_alive() for client in clients)

    together.wait()
    until(answered, pause=PAUSE_SECONDS)
    grown = round(max(megabytes) - before, 1)
    return {"healthz_s": round(max(seconds), 3), "grown_mb": grown, "statuses": dict(statuses)}


def _megabytes(web: Web) -> float:
    """What the server's processes hold in memory now. Linux alone says it."""
    texts = [Path(f"/proc/{pid}/status").read_text() for pid in family(web.process.pid)]
    return sum(int(text.split("VmRSS:")[1].split()[0]) for text in texts if "VmRSS:" in text) / 1024
