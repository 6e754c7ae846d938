"""How many configurations drawn uniformly from the kfusion space are invalid on the shipped sequence.

A sequence on which everything works, or nothing, teaches a search nothing: between 30 and 80 % should be
invalid while STANDARD is valid. `python -m tests.benchmarks.discrimination [COUNT [SEED]]` measures it and
writes var/benchmarks/discrimination.json.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from slam.benchmark import Report, run
from slam.datasets import Sequence, open_sequence
from slam.kfusion.configuration import ANDROID_APP, DEFAULT

ROOT = Path(__file__).resolve().parents[2]
SEQUENCE = ROOT / "fixtures" / "sequences" / "living-room"
SPACE = ROOT / "pareto" / "spaces" / "kfusion.json"
RESULT = ROOT / "var" / "benchmarks" / "discrimination.json"
# The maximal error never shrinks with more frames, so what fails early need not be run to the end.
PREFIXES = (15, 40, 100)


def measure(configuration: dict[str, object], sequence: Sequence) -> Report:
    """The report over the shortest prefix that shows the configuration invalid, or over all frames."""
    for frames in PREFIXES:
        report = run(configuration, sequence, frames=frames)
        if not report.valid:
            break
    return report


def main(count: int = 200, seed: int = 1) -> None:
    sequence = open_sequence(SEQUENCE)
    for name, configuration in {"DEFAULT": DEFAULT, **ANDROID_APP}.items():
        report = run(configuration.to_dict(), sequence)
        print(f"{name:9} max error {report.ate.max:.4f} m, {1e3 * report.runtime:.1f} ms a frame")
    parameters = json.loads(SPACE.read_text())["parameters"]
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(count):
        configuration = {p["name"]: p["values"][rng.integers(len(p["values"]))] for p in parameters}
        report = measure(configuration, sequence)
        rows.append(
            {
                "configuration": configuration,
                "frames": len(report.frames),
                "ate_max": report.ate.max,
                "valid": report.valid,
                "runtime": report.runtime,
            }
        )
        invalid = sum(not row["valid"] for row in rows)
        print(f"\r{number + 1}/{count}: {invalid} invalid", end="", flush=True)
    print(f"\n{100 * invalid / count:.1f} % of {count} configurations are invalid")
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text(
        json.dumps({"sequence": sequence.sha256, "seed": seed, "invalid": invalid, "rows": rows}, indent=1)
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
