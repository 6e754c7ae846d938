"""What a suggestion costs after thousands of measurements."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from pareto import Explorer, Space
from tests.benchmarks.pareto_problems import ROOT
from tests.benchmarks.synthetic_kfusion import evaluate

MEASURED = (1000, 5000)  # points before suggestions are timed
BATCHES, BATCH = 12, 10
SUGGESTION_AIM = 0.3  # CPU seconds


def timings() -> dict[str, Any]:
    """Measure and print all; `rows` with `what`, `seconds` (wall), `cpu_seconds`, `aim_seconds`."""
    rows = [*map(suggestions, MEASURED)]
    print(f"\n{'seconds':<44}{'ours':>9}{'CPU':>9}")
    for row in rows:
        print(f"{row['what']:<44}{row['seconds']:>9.3f}{row['cpu_seconds']:>9.3f}  {row['note']}")
    return {"rows": rows}


def suggestions(measured: int) -> dict[str, Any]:
    """BATCHES of BATCH suggestions of one search, after `measured` points drawn from the kfusion space.

    `cpu_seconds` is the mean of one suggestion, `median` that of the batches: most of them were chosen ahead.
    """
    space = Space.load(ROOT / "pareto" / "spaces" / "kfusion.json")
    most = float(evaluate(space, np.array([space.encode(space.default)]))[0, 1])
    search = Explorer(space, ["error", "time"], {"error": 0.05, "time": most}, seed=0)
    known = np.random.default_rng(0).choice(len(space), measured, replace=False)
    batch = [space.decode(index) for index in known.tolist()]
    wall, cpu = [], []
    for _ in range(BATCHES):
        values = evaluate(space, np.array([space.encode(point) for point in batch]))
        search.tell(
            batch, [None if np.isnan(row).any() else {"error": row[0], "time": row[1]} for row in values]
        )
        begun, used = time.perf_counter(), time.process_time()
        batch = search.ask(BATCH)
        wall.append((time.perf_counter() - begun) / BATCH)
        cpu.append((time.process_time() - used) / BATCH)
    return {
        "what": f"a suggestion after {measured:,} measurements",
        "seconds": float(np.mean(wall)),
        "cpu_seconds": float(np.mean(cpu)),
        "median": float(np.median(cpu)),
        "largest": max(cpu),
        "aim_seconds": SUGGESTION_AIM,
        "note": f"median CPU {np.median(cpu):.3f}, largest {max(cpu):.3f} (batches of {BATCH})",
    }
