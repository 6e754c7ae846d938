"""python -m tests.benchmarks.sequences: the points of a front on every synthetic sequence, and on a real one.

Runs configurations of a front (default: all of kfusion-3) over the learned-on and the held-out scenes at
their usual length, and over three windows of 100 frames of the real recording redkitchen where
FRONTRUNNER_DATA names it. Sequences are made under $FRONTRUNNER_VAR/sequences once. Writes a row for each run
to var/benchmarks/sequences.json, goes on where it stopped, and prints tables in Markdown.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from slam.benchmark import run
from slam.datasets import Sequence, open_sequence
from slam.datasets.prepared import default_folder, make_all
from slam.datasets.scenes import with_role
from slam.devices.choice import choose_device
from slam.systems import open_session

ROOT = Path(__file__).resolve().parents[2]
FRONT = ROOT / "fixtures" / "fronts" / "kfusion-3.json"
RESULT = ROOT / "var" / "benchmarks" / "sequences.json"
WINDOW = 100  # frames
REAL_STARTS = (0, 100, 200)
REAL_VOLUME, REAL_POSITION = 6.0, (0.5, 0.5, 0.1)


class Excerpt(Sequence):
    """`count` frames of `sequence` from frame `start` on, as a sequence of its own."""

    def __init__(self, sequence: Sequence, start: int, count: int) -> None:
        self._sequence, self._start = sequence, start
        frames = slice(start, start + count)
        self.name = f"{sequence.name}-{start}"
        self.camera = sequence.camera
        self.timestamps = sequence.timestamps[frames]
        self.truth = None if sequence.truth is None else sequence.truth[frames]
        self.volume_size, self.initial_position = REAL_VOLUME, REAL_POSITION

    def depth(self, index: int):
        self.check_index(index)
        return self._sequence.depth(self._start + index)

    @property
    def sha256(self) -> str:
        return hashlib.sha256(f"{self._sequence.sha256} {self._start} {len(self)}".encode()).hexdigest()


def sequences(folder: Path) -> Iterator[Sequence]:
    """The learned-on sequences, the held-out ones, and windows of the real one."""
    for path in make_all([*with_role("learned-on"), *with_role("held-out")], folder):
        yield open_sequence(path)
    data = os.environ.get("FRONTRUNNER_DATA")
    if data:
        recording = open_sequence(Path(data) / "rgbd" / "redkitchen")
        for start in REAL_STARTS:
            yield Excerpt(recording, start, WINDOW)


def measure(points: list[dict[str, Any]], folder: Path, result: Path) -> list[dict[str, Any]]:
    """Run what `result` does not hold yet; a row is a configuration on a sequence."""
    rows: list[dict[str, Any]] = json.loads(result.read_text()) if result.exists() else []
    done = {(row["name"], row["sequence"]) for row in rows}
    session = open_session("kfusion", choose_device(None, "opencl"))
    result.parent.mkdir(parents=True, exist_ok=True)
    for sequence in sequences(folder):
        for point in points:
            if (point["name"], sequence.name) in done:
                continue
            report = run(point["parameters"], sequence, device=session)
            assert report.ate is not None
            rows.append(
                {
                    "name": point["name"],
                    "sequence": sequence.name,
                    "ate_max": report.ate.max,
                    "ate_mean": report.ate.mean,
                    "lost": sum(frame.tracked is False for frame in report.frames),
                    "runtime": report.runtime,
                    "cpu_seconds": report.cpu_seconds / len(report.frames),
                }
            )
            result.write_text(json.dumps(rows, indent=1) + "\n")
            sys.stderr.write(f"{sequence.name} {point['name']}: {100 * report.ate.max:.2f} cm\n")
    return rows


def table(rows: list[dict[str, Any]], cell: Callable[[dict[str, Any], dict[str, Any]], str]) -> str:
    """Markdown: a line for each configuration, a column for each sequence; `cell(row, default's row)`."""
    names = list(dict.fromkeys(row["name"] for row in rows))
    columns = list(dict.fromkeys(row["sequence"] for row in rows))
    found = {(row["name"], row["sequence"]): row for row in rows}
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for name in names:
        cells = [
            cell(found[name, column], found["default", column]) if (name, column) in found else "not run"
            for column in columns
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def error_cell(row: dict[str, Any], _default: dict[str, Any]) -> str:
    """The largest error in cm, and the number of lost frames where there are any."""
    return f"{100 * row['ate_max']:.2f}" + (f" ({row['lost']})" if row["lost"] else "")


def ratio_cell(row: dict[str, Any], default: dict[str, Any]) -> str:
    """CPU time of the default over that of the configuration."""
    return f"{default['cpu_seconds'] / row['cpu_seconds']:.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--front", type=Path, default=FRONT)
    parser.add_argument("--only", help="names of configurations with commas; default comes first in any case")
    parser.add_argument("--sequences", type=Path, default=default_folder())
    parser.add_argument("--result", type=Path, default=RESULT)
    options = parser.parse_args()
    points = json.loads(options.front.read_text())["configurations"]
    if options.only:
        names = {"default", *options.only.split(",")}
        points = [point for point in points if point["name"] in names]
    rows = measure(points, options.sequences, options.result)
    sys.stdout.write("Largest error, cm (lost frames):\n\n" + table(rows, error_cell))
    sys.stdout.write(
        "\nCPU time of the default over that of the configuration:\n\n" + table(rows, ratio_cell)
    )


if __name__ == "__main__":
    main()
