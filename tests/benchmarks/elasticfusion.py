"""Where ElasticFusion's time goes, and how it grows with the map: a part of `make bench-slam`.

    python -m tests.benchmarks.elasticfusion [--frames N] [--sequence PATH]

The sequence needs colour. Growth is measured on maps made by laying copies of the sequence's own surfels over
each other, a few millimetres apart, so that all are active, stable and in view. In the last two rows half of
them are inactive, so that loops are looked for in every frame, and in the last one is closed, too. CPU time
sums all threads.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from slam.datasets import Sequence, open_sequence
from slam.devices.choice import choose_device
from slam.elasticfusion.configuration import Configuration
from slam.elasticfusion.pipeline import ElasticFusion
from slam.registry import open_session
from slam.system import STAGES, Scene
from tests.benchmarks.sequences import SEQUENCE, slam_report

AIM = 400  # CPU milliseconds a frame of 640x480 with a million surfels
SIZES = (250_000, 500_000, 1_000_000)
GROWN_FRAMES = 20  # after which the map is replaced
COUNTED = 5
# Surfels, what becomes of loops, and settings. With a short window half of the map is inactive, and each
# frame looks for loops. None fits as well as "sought" asks for; otherwise one is closed.
GROWN: list[tuple[int, str, dict[str, Any]]] = [
    *((size, "", {}) for size in SIZES),
    (SIZES[-1], "sought", {"time_window": 10, "icp_error_threshold": 1e-12}),
    (SIZES[-1], "closed", {"time_window": 10}),
]
ROWS: list[tuple[str, dict[str, Any]]] = [
    ("default", {}),
    ("fast odometry", {"fast_odometry": 1}),
    ("no SO(3)", {"disable_so3": 1}),
    ("open loop", {"open_loop": 1}),
    ("depth only", {"icp_weight": 100}),
]


def growth(sequence: Sequence, driver: str) -> list[dict[str, Any]]:
    """CPU and stage milliseconds a frame on maps of SIZES surfels, and on the last with loops."""
    session = open_session("elasticfusion", choose_device(driver))
    scene = Scene(sequence.camera, 5.0, (0.5, 0.5, 0.1))
    random, measured = np.random.default_rng(0), []
    for size, loops, settings in GROWN:
        system = ElasticFusion(Configuration.from_mapping(settings), scene, session)
        for index in range(GROWN_FRAMES):
            system.process(sequence.depth(index), sequence.colour(index))
        own = system.surfels.read()
        copies = own[np.sort(np.arange(size) % len(own))]
        if loops:
            old, new = copies[::2], copies[1::2]
            old["first_seen"] = old["last_seen"] = 1
            new["first_seen"] = new["last_seen"] = GROWN_FRAMES
            copies = np.concatenate([old, new])
        copies["position"] += random.normal(0, 0.002, (size, 3))
        copies["confidence"] = 2 * Configuration().confidence_threshold
        system.surfels.write(copies)
        cpu, stages = 0.0, dict.fromkeys(STAGES, 0.0)
        for index in range(GROWN_FRAMES, GROWN_FRAMES + COUNTED):
            depth, colour = sequence.depth(index), sequence.colour(index)
            began = process_time()
            frame = system.process(depth, colour)
            cpu += process_time() - began
            for stage in STAGES:
                stages[stage] += frame.seconds[stage]
        row = {"surfels": size, "loops": loops, "cpu_ms": 1e3 * cpu / COUNTED}
        measured.append(row | {stage: 1e3 * seconds / COUNTED for stage, seconds in stages.items()})
    return measured


def measure(path: Path, driver: str, frames: int) -> dict[str, Any] | None:
    """Print both tables for one device and return what they hold; None for a sequence without colour."""
    sequence = open_sequence(path)
    if sequence.colour(0) is None:
        print(f"\nElasticFusion not measured: {sequence.name} has no colour")
        return None
    frames = min(frames, len(sequence))
    print(f"\nElasticFusion, {sequence.name}, {frames} frames, {driver}; milliseconds a frame, errors in mm")
    heads = "".join(f"{stage:>15}" for stage in STAGES)
    print(f"{'configuration':<15}{'CPU':>8}{'wall':>8}{heads}{'aligned':>10}")
    rows = []
    arguments = ("--system", "elasticfusion", "--frames", str(frames), "--device", driver)
    for name, settings in ROWS:
        report = slam_report(settings, *arguments, sequence=path)
        row: dict[str, Any] = {
            "name": name,
            "cpu_ms": 1e3 * report["cpu_seconds"] / frames,
            "wall_ms": 1e3 * report["runtime"],
            "ate": report["ate"],
            **{stage: 1e3 * np.mean([frame[stage] for frame in report["frames"]]) for stage in STAGES},
        }
        rows.append(row)
        aligned = 1e3 * row["ate"]["rmse_aligned"] if row["ate"] else float("nan")
        cells = "".join(f"{row[stage]:>15.1f}" for stage in STAGES)
        print(f"{name:<15}{row['cpu_ms']:>8.1f}{row['wall_ms']:>8.1f}{cells}{aligned:>10.2f}")
    print(f"{'surfels':<15}{'CPU':>8}{'aim':>8}{heads}")
    grown = growth(sequence, driver)
    for row in grown:
        aim = AIM if row["surfels"] == SIZES[-1] else ""
        name = f"{row['surfels']} {row['loops']}"
        cells = "".join(f"{row[stage]:>15.1f}" for stage in STAGES)
        print(f"{name:<15}{row['cpu_ms']:>8.1f}{aim:>8}{cells}")
    return {"driver": driver, "frames": frames, "configurations": rows, "growth": grown}


def main() -> None:
    parser = argparse.ArgumentParser(description="Where ElasticFusion's time goes.")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--sequence", type=Path, default=SEQUENCE)
    arguments = parser.parse_args()
    measure(arguments.sequence, choose_device().driver, arguments.frames)


if __name__ == "__main__":
    main()
