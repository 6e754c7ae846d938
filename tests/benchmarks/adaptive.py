"""python -m tests.benchmarks.adaptive: configurations that adapt beside the best fixed one.

`best` of the newest front; the same with every second and every third frame tracked; the same with a cautious
and a bold controller; and the front's `adaptive`. Each run is a process of its own, over the sequences of
`tests.benchmarks.sequences`. Writes a row for each to var/benchmarks/adaptive.json and prints tables in
Markdown.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from slam.datasets.synthetic.prepared import default_folder
from tests.benchmarks.sequences import (
    DATA,
    ROOT,
    Row,
    error_cell,
    newest_fronts,
    packs,
    points_of,
    run,
    table,
)

EVERY = {"tracking_rate": 1, "integration_rate": 1, "integrate_translation": 0.05, "integrate_rotation": 0.05}
CONTROLLERS = {
    "adaptive, cautious": {"skip_limit": 1, "skip_translation": 0.03, "skip_rotation": 0.02},
    "adaptive, bold": {"skip_limit": 3, "skip_translation": 0.05, "skip_rotation": 0.03},
}


def configurations() -> dict[str, dict[str, Any]]:
    """Parameters by the names in the tables."""
    points = points_of(newest_fronts()[-1])
    best = points["best"]
    fixed = {f"every {word}": best | {"tracking_rate": rate} for word, rate in (("second", 2), ("third", 3))}
    controlled = {name: best | EVERY | more for name, more in CONTROLLERS.items()}
    return {"best": best} | fixed | controlled | {"adaptive of the front": points["adaptive"]}


def report(folder: Path) -> list[Row]:
    """Measure and print; the rows."""
    rows: list[Row] = []
    result = DATA / "benchmarks" / "adaptive.json"
    result.parent.mkdir(parents=True, exist_ok=True)
    for path in packs(folder):
        for name, parameters in configurations().items():
            rows.append({"program": "", "name": name, "sequence": path.name} | run(ROOT, parameters, path))
            result.write_text(json.dumps(rows, indent=1) + "\n")
    cells = {
        "Largest error, cm (lost frames)": error_cell,
        "CPU time, ms a frame": lambda row: f"{1e3 * row['cpu_seconds']:.2f}",
        "Wall time, ms a frame: mean and 95th percentile": lambda row: (
            f"{1e3 * row['runtime']:.1f}, {1e3 * row['runtime_p95']:.1f}"
        ),
        "Frames skipped, %": lambda row: f"{100 * row['skipped']:.0f}",
    }
    for title, cell in cells.items():
        sys.stdout.write(f"\n{title}:\n\n{table(rows, cell)}")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=Path, metavar="DIR", default=default_folder())
    report(parser.parse_args().sequences)


if __name__ == "__main__":
    main()
