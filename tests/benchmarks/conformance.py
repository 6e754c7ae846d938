"""KinectFusion over the whole shipped sequence on every backend, against published reference trajectories.

Each line is one configuration of a front on one device: its largest deviation, the band of the configuration,
and wall milliseconds a frame. A configuration that does not fit says what it needs.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from slam.benchmark import run
from slam.datasets import open_sequence
from slam.devices.choice import list_devices
from slam.devices.device import BACKENDS, Device, DeviceError
from slam.references.bands import deviation
from slam.registry import open_session
from tests.shipped import KFUSION

NAMES = ("default", "best", "knee", "accurate", "front-01", "front-02")


def measure(sequence_path: Path, names: tuple[str, ...] = NAMES) -> list[dict[str, Any]]:
    """Print and return a row for each configuration called by `names` on each device."""
    front = json.loads(KFUSION.read_text(encoding="utf-8"))
    points = [point for point in front["configurations"] if point["name"] in names]
    print("milliseconds a frame, millimetres")
    print(f"{'configuration':<15}{'backend':<9}{'device':<34}{'deviation':>11}{'band':>8}{'wall':>9}")
    rows = []
    for backend in BACKENDS:
        for device in list_devices(backend):
            for point in points:
                row = _row(sequence_path, point, device)
                rows.append(row)
                start = f"{row['name']:<15}{backend:<9}{row['device'][:33]:<34}"
                if "failure" in row:
                    print(f"{start}  {row['failure']}")
                else:
                    print(f"{start}{row['deviation_mm']:>11.2f}{row['band_mm']:>8.2f}{row['wall_ms']:>9.2f}")
    return rows


def _row(sequence_path: Path, point: dict[str, Any], device: Device) -> dict[str, Any]:
    row = {"name": point["name"], "backend": device.backend, "device": f"{device.name} {device.driver}"}
    trajectory = np.array(point["trajectory"])
    try:
        session = open_session("kfusion", device)
        report = run(
            point["parameters"], open_sequence(sequence_path), frames=len(trajectory), device=session
        )
    except DeviceError as error:
        return row | {"failure": str(error)}
    return row | {
        "deviation_mm": 1e3 * deviation(report.poses[:, :3, 3], trajectory),
        "band_mm": 1e3 * point["band"],
        "wall_ms": 1e3 * report.runtime,
    }
