"""Suggestions; whole-pool prediction beside scikit-learn; the filter beside moocore and paretoset."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import moocore
import numpy as np
from numpy.typing import NDArray

from pareto import Explorer, Space
from pareto.fronts.front import nondominated
from pareto.surrogates.forest import Forest
from tests.benchmarks import pareto_peers as peers
from tests.benchmarks.pareto_problems import ROOT
from tests.benchmarks.synthetic_kfusion import evaluate

POINTS = 1_800_000
LARGE_FRONT = 33_000
PREDICTION_AIM = 0.3  # seconds for mean and spread
MEASURED = (1000, 5000)  # points before suggestions are timed
BATCHES, BATCH = 12, 10
SUGGESTION_AIM = 0.3  # CPU seconds
FILTER_AIMS = {2: 0.1, 3: 1.0}  # seconds, by objectives
ENOUGH = 5.0  # seconds; what takes longer is not repeated
PATIENCE = 300  # seconds that paretoset may take, compiling included


def timings() -> dict[str, Any]:
    """Measure and print all; `rows` with `what`, `seconds` (wall), `cpu_seconds`, `aim_seconds`, `others`."""
    rows = [*map(suggestions, MEASURED), prediction(), *filters()]
    print(f"\n{'1,800,000 points, seconds':<44}{'ours':>9}{'CPU':>9}  others")
    for row in rows:
        others = ", ".join(
            f"{name} {value:.3f}" if isinstance(value, float) else f"{name} {value}"
            for name, value in row["others"].items()
        )
        ours = f"{row['seconds']:>9.3f}{row['cpu_seconds']:>9.3f}"
        print(f"{row['what']:<44}{ours}  {others}{row.get('note', '')}")
    return {"rows": rows}


def best(work: Callable[[], Any], repeats: int = 7) -> dict[str, float]:
    """The least wall and CPU seconds: what the work takes where nothing else disturbs it."""
    wall: list[float] = []
    cpu: list[float] = []
    while len(wall) < repeats and sum(wall) < ENOUGH:
        begun, used = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - begun)
        cpu.append(time.process_time() - used)
    return {"seconds": min(wall), "cpu_seconds": min(cpu)}


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
        "others": {},
        "note": f"median CPU {np.median(cpu):.3f}, largest {max(cpu):.3f} (batches of {BATCH})",
    }


def prediction() -> dict[str, Any]:
    """A forest of 100 trees grown to purity on 3,000 rows, over every point of the kfusion space."""
    space = Space.load(ROOT / "pareto" / "spaces" / "kfusion.json")
    rng = np.random.default_rng(0)
    known = rng.choice(len(space), 3000, replace=False)
    targets = np.log(evaluate(space, known)[:, 1])
    forest = Forest.grow(space.codes(known), targets, space.shape, seed=0, extra=False)
    codes = space.codes(np.arange(len(space)))
    begun = time.perf_counter()
    theirs = forest.estimator.predict(codes.astype(np.float32))
    sklearn_seconds = time.perf_counter() - begun
    tracemalloc.start()
    ours, _ = forest.predict_grid_with_spread()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    difference = float(np.abs(ours - theirs).max())
    return {
        "what": "100 trees: mean and spread",
        **best(forest.predict_grid_with_spread),
        "aim_seconds": PREDICTION_AIM,
        "mean_alone": best(forest.predict_grid),
        "others": {"scikit-learn (mean)": sklearn_seconds},
        "peak_bytes": peak,
        "largest_difference": difference,
        "note": f"; differs by {difference:.0e} at most, peak {peak / 1e6:.0f} MB",
    }


def filters() -> list[dict[str, Any]]:
    """Random points, and fronts of 33,000, in two and three objectives."""
    absent = peers.missing(("paretoset",))
    rows = []
    for objectives, aim in FILTER_AIMS.items():
        for front in (None, LARGE_FRONT):
            points = cloud(objectives, front)
            found = int(nondominated(points).sum())
            theirs = moocore.is_nondominated(points, keep_weakly=True)
            assert found == int(theirs.sum()), "moocore finds another front"
            shape = "random" if front is None else f"{found:,} on the front"
            rows.append(
                {
                    "what": f"filter, {objectives} objectives, {shape}",
                    **best(lambda points=points: nondominated(points)),
                    "aim_seconds": aim,
                    "front": found,
                    "others": {
                        "moocore": best(
                            lambda points=points: moocore.is_nondominated(points, keep_weakly=True)
                        )["seconds"],
                        "paretoset": absent or paretoset(points),
                    },
                }
            )
    return rows


def cloud(objectives: int, front: int | None) -> NDArray[np.float64]:
    """POINTS points: uniform in the cube, or `front` of them on an octant of a sphere and the rest behind."""
    rng = np.random.default_rng(objectives)
    if front is None:
        return rng.random((POINTS, objectives))
    directions = np.abs(rng.normal(size=(front, objectives)))
    shell = 1.0 - directions / np.linalg.norm(directions, axis=1, keepdims=True)
    behind = shell[rng.integers(front, size=POINTS - front)] + rng.random((POINTS - front, objectives))
    return rng.permutation(np.concatenate([shell, behind]))


def paretoset(points: NDArray[np.float64]) -> float | str:
    """Its seconds for the same points, or why there are none."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.npy"
        np.save(path, points)
        program = peers.PROGRAMS / "paretoset_filter.py"
        try:
            ended = subprocess.run(
                [peers.python(), program, path], capture_output=True, text=True, timeout=PATIENCE
            )
        except subprocess.TimeoutExpired:
            return f"over {PATIENCE} s"
    if ended.returncode:
        return peers.last_line(ended.stderr)
    return float(json.loads(peers.last_line(ended.stdout))["seconds"])
