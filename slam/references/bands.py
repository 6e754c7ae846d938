"""How far devices that compute the same may differ: a reference trajectory and a band for each configuration.

The same kernels round differently on another driver or in another layout, and tracking accumulates the
difference. A client whose trajectory leaves the band computes something else.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.benchmark import run
from slam.configuration import ConfigurationError
from slam.datasets import Sequence
from slam.datasets.sequence import Progress
from slam.devices.choice import choose_device, list_devices, open_session
from slam.devices.device import Device, DeviceError
from slam.devices.layout import KINDS, Layout
from slam.registry import complete
from slam.trajectories.text_files import read_text

# A band is so many times the largest deviation among the devices here, and at least this wide (m):
# other drivers round differently, too.
FACTOR = 3.0
LEAST_BAND = 0.002
# A probe whose band would be wider (m) is left out: where drivers disagree, others would, too.
WIDEST_BAND_OF_A_PROBE = 0.02
DECIMALS = 6  # of a position in metres, and of a band


@dataclass(frozen=True)
class Reference:
    """`trajectory`: positions of the camera (n, 3), m, in the volume's frame, of the first device and layout.

    `deviations`: the largest distance (m) between the positions of any two devices or layouts, by their
    names. `band`: the largest deviation (m) at which a device still computes the same.
    """

    trajectory: NDArray[np.float64]
    deviations: Mapping[tuple[str, str], float]

    @property
    def band(self) -> float:
        return round(max(LEAST_BAND, FACTOR * max(self.deviations.values())), DECIMALS)


def deviation(positions: NDArray[np.float64], trajectory: NDArray[np.float64]) -> float:
    """The largest distance (m) between frames of POSITIONS and TRAJECTORY, both (n, 3) in the volume's
    frame.
    """
    return float(np.linalg.norm(positions - trajectory, axis=1).max())


def reference(
    configuration: Mapping[str, Any],
    sequence: Sequence,
    frames: int,
    progress: Progress | None = None,
) -> Reference:
    """Run CONFIGURATION of KinectFusion over the first FRAMES of SEQUENCE on every device, as in `variants`.

    A device of WebGPU whose limits it exceeds is left out. PROGRESS is called after each frame. Raises
    NoDeviceError where there is no OpenCL device.
    """
    choose_device()
    positions = {}
    for name, device, layout in variants():
        session = open_session(device, layout)
        try:
            report = run(configuration, sequence, frames=frames, device=session, progress=progress)
        except DeviceError:
            if device.backend == "opencl":
                raise
            continue
        positions[name] = report.poses[:, :3, 3]
    for name, found in positions.items():
        if not np.isfinite(found).all():
            raise DeviceError(f"{name}: the trajectory is not finite, so it cannot be compared")
    first = next(iter(positions.values()))
    return Reference(
        first.round(DECIMALS),
        {(a, b): deviation(positions[a], positions[b]) for a, b in combinations(positions, 2)},
    )


def variants() -> Iterator[tuple[str, Device, Layout]]:
    """Each OpenCL device in each layout and each WebGPU device in that of browsers, with its name."""
    for device in list_devices():
        for kind in KINDS:
            yield f"{device.name} {device.driver}, {kind}", device, Layout(kind)
    for device in list_devices("webgpu"):
        yield f"{device.name} {device.driver}, WebGPU", device, Layout("pixels")


def read_front(path: Path) -> dict[str, Any]:
    """The front in a JSON file. Raises ConfigurationError where it has no configurations of KinectFusion."""
    try:
        front = json.loads(read_text(path, ConfigurationError))
        for configuration in [*front["configurations"], *front.get("probes", [])]:
            complete("kfusion", configuration["parameters"])
            str(configuration["name"])
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ConfigurationError(
            f"{path} is not a front: each configuration needs name and parameters"
        ) from error
    return dict(front)


def front_text(front: Mapping[str, Any]) -> str:
    """FRONT as JSON with a position on a line."""
    text = json.dumps(front, indent=2, allow_nan=False)
    return re.sub(r"\[\s+(-?[\d.e-]+),\s+(-?[\d.e-]+),\s+(-?[\d.e-]+)\s+\]", r"[\1, \2, \3]", text) + "\n"
