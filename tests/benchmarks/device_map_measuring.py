"""python -m tests.benchmarks.device_map_measuring: a front's probe pool on several devices of one machine.

A device is a driver, a layout of the kernels and a number of processor cores. All of one machine, they still
differ widely in what a stage costs. Every configuration of the front runs in a process of its own, twice, and
the quieter run counts. Writes docs/research/device-map.csv: measured for research, not by the crowd.

`--driver NAME=VARIABLE=VALUE,...` adds a driver that the machine's loader does not find by itself.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slam.protocol import FIRST_COUNTED_FRAME
from tests.benchmarks.sequences import ROOT, slam_report
from tests.shipped import KFUSION

RESULT = ROOT / "docs" / "research" / "device-map.csv"
STAGES = ("preprocessing", "tracking", "integration", "raycasting")
COLUMNS = ("device", "family", "backend", "layout", "cores", "configuration", "frames", "seconds", *STAGES)
ROUNDS = 2
FRAMES = {"opencl": 40, "webgpu": 20}
WEBGPU_CONFIGURATIONS = 20  # these devices are slow

Row = dict[str, Any]


@dataclass(frozen=True)
class TestDevice:
    """A driver (its `family`) with a layout of the kernels on so many cores."""

    family: str
    backend: str
    layout: str
    cores: int
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return f"{self.family} {self.layout} {self.cores}"


def devices(drivers: dict[str, dict[str, str]]) -> Iterator[TestDevice]:
    """Two layouts and two numbers of cores for each OpenCL driver; pixels alone for WebGPU."""
    for family, environment in drivers.items():
        backend = "webgpu" if "VK_ICD_FILENAMES" in environment else "opencl"
        for layout in ("rows", "pixels") if backend == "opencl" else ("pixels",):
            for cores in (2, 1):
                yield TestDevice(family, backend, layout, cores, environment)


def pool(front: Path) -> dict[str, dict[str, Any]]:
    """Parameters of the front's points and probes, by name, the default first."""
    content = json.loads(front.read_text())
    return {point["name"]: point["parameters"] for point in [*content["configurations"], *content["probes"]]}


def run(device: TestDevice, parameters: dict[str, Any]) -> Row | None:
    """Mean seconds of a counted frame and of its stages; None where the device cannot hold it."""
    try:
        content = slam_report(
            parameters,
            *("--frames", str(FRAMES[device.backend]), "--backend", device.backend),
            env=os.environ | device.environment | {"FRONTRUNNER_KERNELS": device.layout},
            preexec_fn=lambda: os.sched_setaffinity(0, range(device.cores)),
        )
    except subprocess.CalledProcessError:
        return None
    counted = content["frames"][FIRST_COUNTED_FRAME:]
    stages = {stage: [frame[stage] for frame in counted] for stage in STAGES}
    means = {stage: sum(values) / len(values) for stage, values in stages.items() if None not in values}
    return {"seconds": content["runtime"]} | means


def measure(device: TestDevice, configurations: dict[str, dict[str, Any]]) -> Iterator[Row]:
    """The quieter of ROUNDS runs of each configuration on `device`."""
    found: dict[str, Row] = {}
    for _ in range(ROUNDS):
        for name, parameters in configurations.items():
            row = run(device, parameters)
            if row is not None and (name not in found or row["seconds"] < found[name]["seconds"]):
                found[name] = row
    for name, row in found.items():
        yield {
            "device": device.name,
            "family": device.family,
            "backend": device.backend,
            "layout": device.layout,
            "cores": device.cores,
            "configuration": name,
            "frames": FRAMES[device.backend],
        } | {key: f"{value:.7f}" for key, value in row.items()}


def webgpu_pool(configurations: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The default, best and others at equal steps."""
    first = {name: configurations[name] for name in ("default", "best")}
    others = [name for name in configurations if name not in first]
    step = len(others) / (WEBGPU_CONFIGURATIONS - len(first))
    chosen = [others[int(step * place)] for place in range(WEBGPU_CONFIGURATIONS - len(first))]
    return first | {name: configurations[name] for name in chosen}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--front", type=Path, default=KFUSION)
    parser.add_argument("--driver", action="append", required=True, metavar="NAME=VARIABLE=VALUE,...")
    parser.add_argument("--result", type=Path, default=RESULT)
    options = parser.parse_args()
    drivers = {}
    for text in options.driver:
        name, _, settings = text.partition("=")
        drivers[name] = dict(setting.split("=", 1) for setting in settings.split(",") if setting)
    configurations = pool(options.front)
    with options.result.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for device in devices(drivers):
            chosen = webgpu_pool(configurations) if device.backend == "webgpu" else configurations
            for row in measure(device, chosen):
                writer.writerow(row)
            stream.flush()
            sys.stderr.write(f"{device.name}: done\n")


if __name__ == "__main__":
    main()
