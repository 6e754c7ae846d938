"""CPU time of SLAM before and now, what bounds it, and where it goes: a part of `make bench-slam`.

    python -m tests.benchmarks.speed [--base REV] [--frames N] [--repeats N]

Each case runs by the program of another commit and by this one in turn, each run a process of its own, on the
first OpenCL device; the table has the medians. `bound` is the larger of two: the time of the same frame with
one work-group a launch (measured in the same run), and the memory traffic of the frame at MEMORY_RATE
(docs/research/slam-speed.md derives it). The profile waits for each kernel: its sum is larger than a frame.

Then evaluations of an exploration, each a process over EVALUATED_SEQUENCES: how many fit in an hour, and how
many would if an evaluation were its frames alone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from slam.kfusion.configuration import ANDROID_APP, DEFAULT, STANDARD
from tests.benchmarks import sequences
from tests.benchmarks.sequences import ROOT, SEQUENCE, slam_report

MEMORY_RATE = 15.0  # GB/s of one core, which is what a CPU-second can move at most
SHOWN = 12  # kernels of a profile
EVALUATED_SEQUENCES = 6
EVALUATED_CASES = ("best of the front", "default")  # the fastest and the slowest

Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A configuration of a system. `traffic`: megabytes that a frame reads and writes at least."""

    name: str
    system: str
    settings: dict[str, Any]
    traffic: float


def cases() -> list[Case]:
    """The two defaults, the app's fastest configuration, the front's, and ElasticFusion's default."""
    points = sequences.points_of(sequences.newest_fronts()[-1])
    return [
        Case("default", "kfusion", DEFAULT.to_dict(), 110),
        Case("STANDARD", "kfusion", STANDARD.to_dict(), 42),
        Case("FAST1", "kfusion", ANDROID_APP["FAST1"].to_dict(), 4),
        Case("best of the front", "kfusion", points["best"], 2),
        Case("ElasticFusion", "elasticfusion", {}, 185),
    ]


def run(program: Path, module: str, case: Case, frames: int) -> Row:
    """What `module`, of the folder peers, prints about `case` run by the `slam` in the folder `program`."""
    script = Path(__file__).parent / "peers" / f"{module}.py"
    settings = json.dumps(case.settings)
    command = [sys.executable, str(script), case.system, str(SEQUENCE), str(frames), settings]
    environment = os.environ | {"PYTHONPATH": str(program)}
    ended = subprocess.run(command, cwd=program, env=environment, check=True, stdout=subprocess.PIPE)
    return dict(json.loads(ended.stdout))


def measure(base: str, frames: int, repeats: int) -> list[Row]:
    """A row for each case; the program of `base` and this one take turns."""
    programs = {"before": sequences.checkout(base), "now": ROOT}
    rows = []
    for case in cases():
        runs: dict[str, list[Row]] = {name: [] for name in programs}
        for _ in range(repeats):
            for name, program in programs.items():
                runs[name].append(run(program, "cpu_time", case, frames))
        profile = run(ROOT, "kernel_times", case, frames)
        rows.append({
            "name": case.name,
            **{name: median(each["cpu_ms"] for each in made) for name, made in runs.items()},
            "bound": max(case.traffic / MEMORY_RATE, runs["now"][0]["launches_ms"]),
            "errors": {name: made[0]["ate"] for name, made in runs.items()},
            "kernels": profile["kernels"],
        })  # fmt: skip
    return rows


def keeps_depth(program: Path) -> bool:
    """Whether the `program` can keep decoded depth for later runs."""
    command = [sys.executable, "-m", "slam", "run", "--help"]
    help_page = subprocess.run(command, cwd=program, check=True, capture_output=True, text=True)
    return "--decoded" in help_page.stdout


def evaluate(program: Path, case: Case, frames: int, decoded: Path | None) -> tuple[float, float]:
    """Seconds of an evaluation of `case` by `program`, and of its frames. `decoded`: where it keeps depth."""
    arguments = ["--system", case.system, "--frames", str(frames)]
    arguments += ["--sequence", str(SEQUENCE)] * (EVALUATED_SEQUENCES - 1)  # besides the first
    arguments += ["--decoded", str(decoded)] if decoded else []
    began = time.perf_counter()
    runs = slam_report(case.settings, *arguments, program=program)["runs"]
    seconds = time.perf_counter() - began
    return seconds, sum(each["runtime"] * len(each["frames"]) for each in runs)


def measure_evaluations(base: str, frames: int, repeats: int) -> list[Row]:
    """Evaluations an hour: a row for each of EVALUATED_CASES. The first, which decodes, is not counted."""
    programs = {"before": sequences.checkout(base), "now": ROOT}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        decoded = {
            name: Path(folder) / name if keeps_depth(program) else None for name, program in programs.items()
        }
        for case in cases():
            if case.name not in EVALUATED_CASES:
                continue
            made: dict[str, list[tuple[float, float]]] = {name: [] for name in programs}
            for _ in range(1 + repeats):
                for name, program in programs.items():
                    made[name].append(evaluate(program, case, frames, decoded[name]))
            rows.append({
                "name": case.name,
                **{name: 3600 / median(seconds for seconds, _ in each[1:]) for name, each in made.items()},
                "bound": 3600 / median(seconds for _, seconds in made["now"][1:]),
            })  # fmt: skip
    return rows


def report(base: str, frames: int, repeats: int = 3) -> dict[str, list[Row]]:
    """Measure and print; the rows of both tables."""
    rows = measure(base, frames, repeats)
    print(f"\nCPU milliseconds a frame at {base}, now, and their bound; mean and largest error in mm")
    print(f"{'':<20}{'before':>8}{'now':>8}{'ratio':>8}{'bound':>8}{'before':>16}{'now':>16}")
    for row in rows:
        errors = "".join(
            f"{1e3 * error['mean']:>10.2f}{1e3 * error['max']:>6.2f}" for error in row["errors"].values()
        )
        ratio = row["now"] / row["before"]
        print(
            f"{row['name']:<20}{row['before']:>8.2f}{row['now']:>8.2f}{ratio:>8.2f}{row['bound']:>8.2f}{errors}"
        )
    for row in rows:
        print(f"\n{row['name']}, milliseconds a frame by kernel")
        for name, spent in list(row["kernels"].items())[:SHOWN]:
            print(f"{name:<28}{spent:>8.2f}")
    evaluations = measure_evaluations(base, frames, repeats)
    print(f"\nEvaluations an hour, {EVALUATED_SEQUENCES} sequences each, and their bound: frames alone")
    print(f"{'':<20}{'before':>8}{'now':>8}{'ratio':>8}{'bound':>8}")
    for row in evaluations:
        ratio = row["now"] / row["before"]
        print(f"{row['name']:<20}{row['before']:>8.0f}{row['now']:>8.0f}{ratio:>8.2f}{row['bound']:>8.0f}")
    return {"frames": rows, "evaluations": evaluations}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", metavar="REV", default="HEAD", help="the commit before (HEAD)")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    report(arguments.base, arguments.frames, arguments.repeats)


if __name__ == "__main__":
    main()
