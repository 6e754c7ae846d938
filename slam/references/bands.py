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
from slam.datasets.altered import Perturbed
from slam.datasets.sequence import Progress
from slam.definitions import definition
from slam.devices.choice import choose_device, list_devices, open_session
from slam.devices.device import Device, DeviceError
from slam.devices.layout import KINDS, Layout
from wire.protocol import FIRST_COUNTED_FRAME

# A band is so many times the largest deviation among the devices here, and at least this wide (m):
# other drivers round differently, too.
FACTOR = 3.0
LEAST_BAND = 0.002
# Where the devices here disagree by more (m), others would, too: such a point is not published.
WIDEST_BAND = 0.02
LEAST_VARIANTS = 2
# Further runs with depth changed by one unit, of a configuration that leaves out frames: where a threshold
# decides, rounding makes the trajectory jump.
PERTURBATIONS = range(1, 6)
THREADS = (1, 2, 4)  # of WebAssembly: those that browsers choose from
DECIMALS = 6  # of a position in metres, and of a band
SHARE_DECIMALS = 4


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
    two of them, and between those of the first with and without changed depth. `skips`: the configuration
    leaves out frames by the camera's motion.
    """

    report: Report
    trajectory: NDArray[np.float64]
    variants: tuple[str, ...]
    deviations: Mapping[tuple[str, str], float]
    skips: bool = False

    @property
    def largest_deviation(self) -> float:
        """In metres; 0 for a single variant."""
        return max(self.deviations.values(), default=0.0)

    @property
    def skipped(self) -> float | None:
        """The share of the counted frames that the first variant left out; None if all are computed."""
        counted = self.report.frames[FIRST_COUNTED_FRAME:] or self.report.frames
        share = sum(frame.skipped for frame in counted) / len(counted)
        return round(share, SHARE_DECIMALS) if self.skips else None

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

    One that leaves out frames runs on the first variant again, with depth changed by each of PERTURBATIONS.
    A WebGPU device whose limits it exceeds is left out. `progress` is called with each variant's name before
    it runs. Raises NoDeviceError where there is neither an OpenCL device nor WebAssembly, DeviceError where a
    trajectory is not finite, and what `slam.benchmark.run` raises.
    """
    compared = list(variants(system))
    if all(device.backend == "webgpu" for _, device, *_ in compared):
        choose_device()  # its error says what to install

    def measured(variant: Variant, images: Sequence, name: str) -> Report:
        session = open_session(variant.device, variant.layout, variant.threads)
        return run(
            configuration, images, system=system, frames=frames, device=session, progress=progress(name)
        )

    reports: dict[str, Report] = {}
    for variant in compared:
        try:
            reports[variant.name] = measured(variant, sequence, variant.name)
        except DeviceError:
            if variant.device.backend != "webgpu":
                raise
    ran = tuple(reports)
    skips = definition(system).skips(configuration)
    [first] = (variant for variant in compared if variant.name == ran[0])
    changed = {f"{first.name}, changed depth {seed}": seed for seed in PERTURBATIONS if skips}
    for name, seed in changed.items():
        reports[name] = measured(first, Perturbed(sequence, seed), name)
    positions = {name: report.poses[:, :3, 3] for name, report in reports.items()}
    for name, poses in positions.items():
        if not np.isfinite(poses).all():
            raise DeviceError(f"{name}: the trajectory is not finite, so it cannot be compared")
    pairs = [*combinations(ran, 2), *((first.name, name) for name in changed)]
    return Reference(
        reports[first.name],
        positions[first.name].round(DECIMALS),
        ran,
        {(a, b): deviation(positions[a], positions[b]) for a, b in pairs},
        skips,
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
