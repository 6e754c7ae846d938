"""Counters and histograms in Prometheus' text format, over all processes of this machine.

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
from dataclasses import dataclass
from pathlib import Path

# Upper bounds in seconds: those that Prometheus' own libraries use, and those of tasks that may take an hour.
BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
TASK_BUCKETS = (0.01, 0.1, 1.0, 10.0, 60.0, 600.0, 3600.0)
SAVE_SECONDS = 1.0

Key = tuple[str, ...]  # the name of a metric, and the values of its labels
Row = list[
    float
]  # of a counter: its value; of a histogram: how many in each bucket and beyond, and their sum

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Metric:
    """What is counted, by which labels. A histogram has buckets, a counter has none."""

    text: str
    labels: tuple[str, ...]
    buckets: tuple[float, ...] = ()


METRICS = {
    "request_seconds": Metric("Seconds to answer a request", ("method", "endpoint", "status"), BUCKETS),
    "task_seconds": Metric("Seconds of a task, by how it ended", ("task", "state"), TASK_BUCKETS),
    "problems_total": Metric("Requests that got a problem, by its code", ("endpoint", "code")),
}


class Registry:
    """The values of METRICS. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows: dict[Key, Row] = {}
        self._copy: Path | None = None
        self._saving = False

    def share(self, folder: Path, kind: str) -> None:
        """From now on write copies to `folder` as a process of that `kind`, and add those of the others."""
        self._copy = folder / f"{kind}-{os.getpid()}-{time.time_ns()}.json"
        self._save()

    def count(self, name: str, *labels: str) -> None:
        """Add one to a counter."""
        self._add((name, *labels), [1.0])

    def observe(self, name: str, seconds: float, *labels: str) -> None:
        """Add a value to a histogram."""
        buckets = METRICS[name].buckets
        row = [0.0] * (len(buckets) + 2)
        row[bisect_left(buckets, seconds)] = 1.0
        row[-1] = seconds
        self._add((name, *labels), row)

    def rows(self) -> dict[Key, Row]:
        """The sums over this process and all processes that share its folder."""
        with self._lock:
            sums = dict(self._rows)
        for key, row in self._others():
            sums[key] = _sum(sums.get(key), row)
        return sums

    def _add(self, key: Key, row: Row) -> None:
        with self._lock:
            self._rows[key] = _sum(self._rows.get(key), row)
            if self._copy is None or self._saving:
                return
            self._saving = True
        timer = threading.Timer(SAVE_SECONDS, self._save)
        timer.daemon = True
        timer.start()

    def _save(self) -> None:
        assert self._copy is not None  # only a process that shares its values saves them
        with self._lock:
            self._saving = False
            content = json.dumps(list(self._rows.items()))
        draft = self._copy.with_suffix(".part")
        try:
            draft.parent.mkdir(exist_ok=True)
            draft.write_text(content)
            draft.replace(self._copy)
        except OSError as error:
            log.warning("cannot write metrics to %s: %s", self._copy, error.strerror)

    def _others(self) -> Iterator[tuple[Key, Row]]:
        if self._copy is None:
            return
        for path in self._copy.parent.glob("*.json"):
            if path == self._copy:
                continue
            # The folder may be cleared meanwhile.
            with contextlib.suppress(FileNotFoundError):
                for key, row in json.loads(path.read_text()):
                    yield tuple(key), row


def _sum(row: Row | None, other: Row) -> Row:
    return other if row is None else [a + b for a, b in zip(row, other, strict=True)]


registry = Registry()


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


def exposition(rows: Mapping[Key, Row]) -> str:
    """The lines of all counters and histograms."""
    lines = []
    for name, metric in METRICS.items():
        kind = "histogram" if metric.buckets else "counter"
        lines += [f"# HELP frontrunner_{name} {metric.text}", f"# TYPE frontrunner_{name} {kind}"]
        for key, row in sorted(rows.items()):
            if key[0] == name:
                labels = ",".join(map(label, metric.labels, key[1:]))
                lines += _samples(f"frontrunner_{name}", labels, metric.buckets, row)
    return "\n".join(lines) + "\n"


def _samples(name: str, labels: str, buckets: tuple[float, ...], row: Row) -> Iterator[str]:
    if not buckets:
        yield f"{name}{{{labels}}} {_number(row[0])}"
        return
    total = 0.0
    for bound, count in zip((*map(str, buckets), "+Inf"), row[:-1], strict=True):
        total += count
        yield f'{name}_bucket{{{labels},le="{bound}"}} {_number(total)}'
    yield f"{name}_sum{{{labels}}} {row[-1]:.6f}"
    yield f"{name}_count{{{labels}}} {_number(total)}"


def _number(value: float) -> str:
    return f"{value:.0f}" if float(value).is_integer() else repr(value)
