"""Request counts and durations in Prometheus' text format, over all processes of this machine.

Each process counts in memory and writes a copy to a folder, at most once a second. The process that answers
/metrics adds the copies up. Copies of dead processes still count. They are deleted when the service starts
again (`remove_old_copies`), which counters may do. If the disk is full, the copies only become outdated.
"""

import contextlib
import json
import logging
import os
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from pathlib import Path

# Upper bounds in seconds, those that Prometheus' own libraries use.
BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
SAVE_SECONDS = 1.0

Key = tuple[str, str, int]  # method, endpoint, status
Row = list[float]  # requests per bucket, requests beyond the last bucket, the sum of their seconds

log = logging.getLogger(__name__)


class Requests:
    """Histograms of answer times. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows: dict[Key, Row] = {}
        self._copy: Path | None = None
        self._saving = False

    def share(self, folder: Path) -> None:
        """From now on write copies to `folder`, and add those of the other processes there."""
        self._copy = folder / f"{os.getpid()}-{time.time_ns()}.json"

    def observe(self, method: str, endpoint: str, status: int, seconds: float) -> None:
        """Count one request."""
        with self._lock:
            row = self._rows.setdefault((method, endpoint, status), [0.0] * (len(BUCKETS) + 2))
            row[bisect_left(BUCKETS, seconds)] += 1
            row[-1] += seconds
            if self._copy is None or self._saving:
                return
            self._saving = True
        timer = threading.Timer(SAVE_SECONDS, self._save)
        timer.daemon = True
        timer.start()

    def rows(self) -> dict[Key, Row]:
        """The sums over this process and all processes that share its folder."""
        with self._lock:
            sums = {key: list(row) for key, row in self._rows.items()}
        for key, row in self._others():
            summed = sums.setdefault(key, [0.0] * len(row))
            sums[key] = [a + b for a, b in zip(summed, row, strict=True)]
        return sums

    def _save(self) -> None:
        assert self._copy is not None  # observe() starts the timer only with a folder
        with self._lock:
            self._saving = False
            content = json.dumps([[*key, row] for key, row in self._rows.items()])
        draft = self._copy.with_suffix(".part")
        try:
            draft.parent.mkdir(exist_ok=True)
            draft.write_text(content)
            draft.replace(self._copy)
        except OSError as error:
            log.warning("cannot write request counts to %s: %s", self._copy, error.strerror)

    def _others(self) -> Iterator[tuple[Key, Row]]:
        if self._copy is None:
            return
        for path in self._copy.parent.glob("*.json"):
            if path == self._copy:
                continue
            # The folder may be cleared meanwhile.
            with contextlib.suppress(FileNotFoundError):
                for method, endpoint, status, row in json.loads(path.read_text()):
                    yield (method, endpoint, status), row


requests = Requests()


def remove_old_copies(folder: Path) -> None:
    """Delete the copies in `folder` that an earlier start of the service left."""
    for path in folder.glob("*"):
        path.unlink(missing_ok=True)


def gauge(name: str, text: str, values: Mapping[str, float]) -> str:
    """The lines of a gauge. `values` are keyed by labels in Prometheus' notation, "" without labels."""
    samples = "".join(
        f"frontrunner_{name}{f'{{{labels}}}' if labels else ''} {_number(value)}\n"
        for labels, value in values.items()
    )
    return f"# HELP frontrunner_{name} {text}\n# TYPE frontrunner_{name} gauge\n{samples}"


def label(name: str, value: str) -> str:
    """`name`="`value`", escaped for Prometheus."""
    escaped = value.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
    return f'{name}="{escaped}"'


def histogram(rows: Mapping[Key, Row]) -> str:
    """The lines of frontrunner_request_seconds."""
    name = "frontrunner_request_seconds"
    lines = [f"# HELP {name} Seconds to answer a request", f"# TYPE {name} histogram"]
    for (method, endpoint, status), row in sorted(rows.items()):
        labels = ",".join((label("method", method), label("endpoint", endpoint), f'status="{status}"'))
        total = 0.0
        for bound, count in zip((*map(str, BUCKETS), "+Inf"), row[:-1], strict=True):
            total += count
            lines.append(f'{name}_bucket{{{labels},le="{bound}"}} {_number(total)}')
        lines.append(f"{name}_sum{{{labels}}} {row[-1]:.6f}")
        lines.append(f"{name}_count{{{labels}}} {_number(total)}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return f"{value:.0f}" if float(value).is_integer() else repr(value)
