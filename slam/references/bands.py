"""How far devices that compute the same may differ: a reference trajectory and a band for a configuration.

The same kernels round differently on another driver or in another layout, and tracking accumulates the
difference. A client whose trajectory leaves the band computes something else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.benchmark import Report, run
from slam.datasets import Sequence
from slam.datasets.sequence import Progress
from slam.definitions import definition
from slam.devices.choice import choose_device, list_devices, open_session
from slam.devices.device import Device, DeviceError
from slam.devices.layout import KINDS, Layout

# A band is so many times the largest deviation among the devices here, and at least this wide (m):
# other drivers round differently, too.
FACTOR = 3.0
LEAST_BAND = 0.002
# Where the devices here disagree by more (m), others would, too: such a point is not published.
WIDEST_BAND = 0.02
LEAST_VARIANTS = 2
THREADS = (1, 2)  # of WebAssembly
DECIMALS = 6  # of a position in metres, and of a band


class Variant(NamedTuple):
    """A device with a layout of its kernels and, over WebAssembly, a number of threads."""

    name: str
    device: Device
    layout: Layout
    threads: int | None = None


@dataclass(frozen=True)
class Reference:
    """`report` and `trajectory`, positions of the camera (n, 3), m, in the volume's frame, are those of the
    first variant.

    `variants`: the names of all that ran. `deviations`: the largest distance (m) between the positions of any
    two of them.
    """

    report: Report
    trajectory: NDArray[np.float64]
    variants: tuple[str, ...]
    deviations: Mapping[tuple[str, str], float]

    @property
    def largest_deviation(self) -> float:
        """In metres; 0 for a single variant."""
        return max(self.deviations.values(), default=0.0)

    @property
    def band(self) -> float:
        """The largest deviation (m) at which a device still computes the same."""
        return round(max(LEAST_BAND, FACTOR * self.largest_deviation), DECIMALS)


def deviation(positions: NDArray[np.float64], trajectory: NDArray[np.float64]) -> float:
    """The largest distance (m) between frames of `positions` and `trajectory`, both (n, 3) in the volume's
    frame.
    """
    return float(np.linalg.norm(positions - trajectory, axis=1).max())


def reference(
    system: str,
    configuration: Mapping[str, Any],
    sequence: Sequence,
    frames: int | None = None,
    progress: Callable[[str], Progress | None] = lambda _name: None,
) -> Reference:
    """Run `configuration` of `system` over the first `frames` (default: all) of `sequence` on every variant
    here.

    A WebGPU device whose limits it exceeds is left out. `progress` is called with each variant's name before
    it runs. Raises NoDeviceError where there is neither an OpenCL device nor WebAssembly, DeviceError where a
    trajectory is not finite, and what `slam.benchmark.run` raises.
    """
    compared = list(variants(system))
    if all(device.backend == "webgpu" for _, device, *_ in compared):
        choose_device()  # its error says what to install
    reports: dict[str, Report] = {}
    for name, device, layout, threads in compared:
        session = open_session(device, layout, threads)
        try:
            reports[name] = run(
                configuration, sequence, system=system, frames=frames, device=session, progress=progress(name)
            )
        except DeviceError:
            if device.backend != "webgpu":
                raise
    positions = {name: report.poses[:, :3, 3] for name, report in reports.items()}
    for name, poses in positions.items():
        if not np.isfinite(poses).all():
            raise DeviceError(f"{name}: the trajectory is not finite, so it cannot be compared")
    first = next(iter(reports))
    return Reference(
        reports[first],
        positions[first].round(DECIMALS),
        tuple(reports),
        {(a, b): deviation(positions[a], positions[b]) for a, b in combinations(positions, 2)},
    )


def variants(system: str) -> Iterator[Variant]:
    """Each OpenCL device in each layout and, if `system` runs there, each WebGPU device in that of browsers,
    and WebAssembly with one thread and with several."""
    backends = definition(system).backends
    for device in list_devices():
        for kind in KINDS:
            yield Variant(f"{device.name} {device.driver}, {kind}", device, Layout(kind))
    for device in list_devices("webgpu") if "webgpu" in backends else ():
        yield Variant(f"{device.name} {device.driver}, WebGPU", device, Layout("pixels"))
    for device in list_devices("wasm") if "wasm" in backends else ():
        for threads in THREADS:
            name = f"{device.name} {device.driver}, WebAssembly, threads: {threads}"
            yield Variant(name, device, Layout("rows"), threads)
