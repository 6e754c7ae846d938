"""python -m tests.benchmarks.stopping: what ending runs of KinectFusion early saves, and what it costs.

Random configurations are run whole, each in a process of its own, and the error and the time of every frame
are stored. The rules of a search (`pareto.search.stopping`, `slam.stopping`) are then replayed on these rows
in their order: which runs end, after which frame, and what of the front is lost. The first RUNS_OF_DEFAULT
runs are the default's, for the noise. `--live N` runs N of the configurations again under the rules, and
compares where they end.

The rows are written after every run; the same command goes on from there, also with more --samples.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from frontrunner.folders import SEQUENCES
from pareto import Censored, Explorer, Space
from slam.protocol import FIRST_COUNTED_FRAME, FIRST_STOP, VALID_BELOW
from slam.stopping import ERROR, TIME, Condition, find_broken, least_time

ROOT = Path(__file__).resolve().parents[2]
ROWS = ROOT / "docs" / "research" / "stopping.json.gz"
SPACE = Space.load(ROOT / "pareto" / "spaces" / "kfusion.json")
RUNS_OF_DEFAULT = 3
MOST_FRAMES = 0.30  # of those of invalid runs: the target
MICRO = 1e-6  # rows hold micrometres and microseconds

Row = dict[str, Any]


@dataclass(frozen=True)
class Replayed:
    """A row and the `frames` after which the rules end it, None for a whole run; `by`: a limit or a point."""

    row: Row
    frames: int | None
    by: str
    conditions: list[Condition]


def configurations(samples: int, seed: int = 0) -> Iterator[dict[str, Any]]:
    """The default RUNS_OF_DEFAULT times, then `samples` random ones; more samples begin with the same."""
    for _ in range(RUNS_OF_DEFAULT):
        yield dict(SPACE.default)
    for index in np.random.default_rng(seed).permutation(len(SPACE))[:samples]:
        yield dict(SPACE.decode(int(index)))


def run(configuration: dict[str, Any], sequence: Path, conditions: Sequence[Condition] = ()) -> Row:
    """One run in a process of its own: errors and times of its frames, or why it `failed`."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "slam", "run", "--sequence", str(sequence), "--json", str(report)]
        command += [f"--set={name}={value}" for name, value in configuration.items()]
        for condition in conditions:
            command += ["--stop-above", ",".join(f"{name}={value!r}" for name, value in condition.items())]
        begun = time.monotonic()
        ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        row: Row = {"configuration": configuration, "process_seconds": round(time.monotonic() - begun, 3)}
        if ended.returncode:
            return row | {"failed": (ended.stderr.strip().splitlines() or ["no message"])[-1]}
        content = json.loads(report.read_text())
    return row | {
        "device": f"{content['device']['name']} {content['device']['driver']}",
        "errors": [round(frame["error"] / MICRO) for frame in content["frames"]],
        "times": [round(frame["computation"] / MICRO) for frame in content["frames"]],
        "lost": sum(frame["tracked"] is False for frame in content["frames"]),
        "stopped_at": content.get("stopped", {}).get("frames"),
    }


def values_after(row: Row, frames: int | None = None) -> dict[str, float]:
    """The largest error (metres) and the mean time (seconds) of a row after so many frames, or of it all."""
    errors, times = row["errors"][:frames], row["times"][FIRST_COUNTED_FRAME:frames]
    return {ERROR: MICRO * max(errors), TIME: MICRO * sum(times) / len(times)}


def end_of(row: Row, conditions: Sequence[Condition]) -> tuple[int | None, str]:
    """After how many frames a condition ends the run of `row`, and whether it is a limit or a point."""
    for frames in range(FIRST_STOP, len(row["errors"])):
        values = values_after(row, frames)
        certain = {ERROR: values[ERROR], TIME: least_time(values[TIME])}
        if broken := find_broken(conditions, certain):
            return frames, "limit" if len(broken) == 1 else "point"
    return None, ""


def replay(rows: Sequence[Row], limit: float) -> tuple[list[Replayed], Explorer]:
    """End each of `rows` as a search would that measures them in this order."""
    explorer = Explorer(SPACE, (ERROR, TIME), {ERROR: limit}, method="random")
    ended = []
    for row in rows:
        configuration = row["configuration"]
        if "failed" in row:
            explorer.tell([configuration], [None])
            continue
        conditions = explorer.stop_conditions(configuration)
        frames, by = end_of(row, conditions)
        values = values_after(row, frames)
        if frames is not None:
            values[ERROR] = Censored(values[ERROR])
        explorer.tell([configuration], [values])
        ended.append(Replayed(row, frames, by, conditions))
    return ended, explorer


def summary(rows: Sequence[Row], limit: float = VALID_BELOW) -> list[str]:
    """What the rules save and cost on `rows`, as lines of Markdown."""
    if not rows:
        return ["no run is stored: `python -m tests.benchmarks.stopping --samples N` makes them"]
    ended, explorer = replay(rows, limit)
    whole = Explorer(SPACE, (ERROR, TIME), {ERROR: limit}, method="random")
    for row in rows:
        whole.tell([row["configuration"]], [None if "failed" in row else values_after(row)])
    valid = [item for item in ended if values_after(item.row)[ERROR] < limit]
    invalid = [item for item in ended if item not in valid]
    same = [configuration for configuration, _ in whole.front()] == [point for point, _ in explorer.front()]
    by_limit = sum(item.by == "limit" for item in valid)
    by_point = sum(item.by == "point" for item in valid)
    change = np.abs(
        [values_after(one.row, FIRST_STOP)[TIME] / values_after(one.row)[TIME] - 1 for one in ended]
    )
    seconds = sum(_seconds(item) for item in ended) / sum(_seconds(item, whole=True) for item in ended)
    processes = sum(item.row["process_seconds"] for item in ended)
    saved = sum(_seconds(item, whole=True) - _seconds(item) for item in ended)
    return [
        f"{len(rows)} runs, {len(rows) - len(ended)} failed, {len(invalid)} not valid, "
        f"on {', '.join(sorted({item.row['device'] for item in ended}))}",
        f"valid configurations ended by a limit: {by_limit} of {len(valid)}; by a finished point: {by_point}",
        f"the front of {len(whole.front())} is {'the same' if same else 'ANOTHER'}",
        f"frames of those not valid: {100 * _share(invalid):.0f} % (at most {100 * MOST_FRAMES:.0f} %)",
        f"frames of all: {100 * _share(ended):.0f} %; seconds of computation: {100 * seconds:.0f} %; "
        f"with process starts: {100 * (1 - saved / processes):.0f} %",
        f"time after {FIRST_STOP} frames beside the whole run's: {100 * np.median(change):.1f} % apart "
        f"(median), {100 * np.quantile(change, 0.95):.1f} % (95th percentile)",
    ]


def compare_live(rows: Sequence[Row], sequence: Path, count: int) -> str:
    """Run `count` configurations under the rules; how many end after the same frame as in the replay."""
    ended, _ = replay(rows, VALID_BELOW)
    chosen = [item for item in ended if item.conditions][:count]
    differing = []
    for item in chosen:
        live = run(item.row["configuration"], sequence, item.conditions)
        if live.get("stopped_at") != item.frames:
            differing.append(f"{item.frames} and {live.get('stopped_at')} ({item.by or 'whole'})")
    same = f"{len(chosen) - len(differing)} of {len(chosen)} live runs ended as in the replay"
    return same + (f"; others after, replayed and live: {', '.join(differing)}" if differing else "")


def read(path: Path) -> list[Row]:
    """The rows in a file; none where there is no file."""
    return json.loads(gzip.decompress(path.read_bytes())) if path.exists() else []


def write(path: Path, rows: list[Row]) -> None:
    """Replace the file, so that an interruption never leaves half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_suffix(".new")
    new.write_bytes(gzip.compress(json.dumps(rows).encode(), mtime=0))
    new.replace(path)


def _share(items: Sequence[Replayed]) -> float:
    """The share of their frames that are run."""
    wanted = sum(len(item.row["errors"]) for item in items)
    return sum(item.frames or len(item.row["errors"]) for item in items) / wanted if wanted else math.nan


def _seconds(item: Replayed, whole: bool = False) -> float:
    return MICRO * sum(item.row["times"][: None if whole else item.frames])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=0, help="random configurations to have run")
    parser.add_argument("--sequence", type=Path, default=SEQUENCES / "living-room")
    parser.add_argument("--rows", type=Path, default=ROWS, metavar="FILE", help=f"({ROWS.relative_to(ROOT)})")
    parser.add_argument(
        "--live",
        type=int,
        default=0,
        metavar="N",
        help="run N again under the rules",
    )
    arguments = parser.parse_args()
    rows = read(arguments.rows)
    for number, configuration in enumerate(configurations(arguments.samples)):
        if number < len(rows) or not arguments.samples:
            continue
        rows.append(run(configuration, arguments.sequence))
        write(arguments.rows, rows)
        print(f"{number + 1}: {rows[-1]['process_seconds']} s {rows[-1].get('failed', '')}", flush=True)
    lines = summary(rows)
    if arguments.live:
        lines.append(compare_live(rows, arguments.sequence, arguments.live))
    print("\n".join(f"- {line}" for line in lines))


if __name__ == "__main__":
    main()
