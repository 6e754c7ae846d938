"""Made-up devices: how fast each runs each configuration, and what it says of itself. Pure, by seed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd.fronts.selectors import DEFAULT
from crowd.results.simulation.families import FAMILIES, Family
from crowd.results.simulation.stages import STAGES, stage_shares

# What a stage costs, over what it costs on the reference device, differs by so much between makers, between
# chips of one and between devices with one chip: standard deviations of the logarithm. Measured devices
# differ by 0.2 to 0.7 together (docs/research/device-map.md).
FAMILY_COST, CHIP_COST, DEVICE_COST = 0.3, 0.2, 0.1
# What stages do not explain of a configuration's time, in a family and on a device; and installations of one
# model.
FAMILY_RESIDUAL, DEVICE_RESIDUAL, INSTALLATION = 0.03, 0.03, 0.03
FIXED = 0.35  # standard deviation of the logarithm of what no configuration saves, within a family
MOST_INSTALLATIONS = 4
FAILING = 0.08  # of the devices, at one configuration each
RELEASE_GAIN = 0.05  # standard deviation of what a new driver does to a configuration
YOUNGER = 0.25  # by how much the logarithm of a time falls from one chip of a family to the next
MAKER = "Simulated"
KINDS = (("configurations", False), ("probes", True))
USUAL_SECONDS = 0.02


@dataclass(frozen=True)
class Configuration:
    """A configuration of the front as the manifest has it: reference seconds a frame, reference ATE (m), and
    the band (m) around its reference trajectory in protocol 2. `stages`: reference times of each in one unit,
    None where the front has none. A `probe` is measured only where it is asked for.
    """

    name: str
    parameters: Mapping[str, Any]
    seconds: float
    ate: float
    band: float | None = None
    stages: Mapping[str, float] | None = None
    probe: bool = False


@dataclass(frozen=True)
class SimulatedDevice:
    """One device model. `seconds` a frame by release of its driver, installation and configuration; `shares`
    of each stage in that, less than 1 together: the rest is what no configuration saves.
    """

    name: str
    family: Family
    descriptions: tuple[dict[str, Any], ...]  # one a release, oldest first
    seconds: NDArray[np.float64]  # (releases, installations, configurations)
    shares: NDArray[np.float64]  # (configurations, stages)
    noise: float  # standard deviation of the logarithm, frame by frame
    throttling: float  # how much slower it is at the end of a long session; 0: not at all
    failing: str  # the configuration that does not run there; "": all do

    @property
    def installations(self) -> int:
        return int(self.seconds.shape[1])


def configurations_of(front: Mapping[str, Any]) -> tuple[Configuration, ...]:
    """The configurations of FRONT, a manifest or a front with its probes. One without a predicted time or
    error gets a usual one.
    """
    rows = [(row, probe) for kind, probe in KINDS for row in front.get(kind, ())]
    default = next((row["predicted"].get("runtime") for row, _ in rows if row["name"] == DEFAULT), None)
    return tuple(
        Configuration(
            row["name"],
            row["parameters"],
            _seconds(row["predicted"], default) or USUAL_SECONDS,
            row["predicted"].get("ate_max") or 0.01,
            row.get("band"),
            row["predicted"].get("on_sequence", {}).get("stages"),
            probe,
        )
        for row, probe in rows
    )


def _seconds(predicted: Mapping[str, Any], default: float | None) -> float | None:
    """Of a frame on the reference device: over the clients' sequence where that is known."""
    times = predicted.get("on_sequence")
    return default * times["runtime_ratio"] if times and default else predicted.get("runtime")


def devices(count: int, front: Sequence[Configuration], seed: int) -> list[SimulatedDevice]:
    """COUNT devices on FRONT, the same for the same SEED, whose models are the same on every front. Raises
    ValueError for none at all.
    """
    if count < 1:
        raise ValueError(f"{count} devices: simulate 1 or more")
    random = np.random.default_rng((seed, 0))
    shares = np.array([family.share for family in FAMILIES])
    chosen = random.choice(len(FAMILIES), size=count, p=shares / shares.sum())
    makers = [
        _Maker.draw(family, front, np.random.default_rng((seed, place, 2)))
        for place, family in enumerate(FAMILIES)
    ]
    return [
        _device(number, makers[maker], front, np.random.default_rng((seed, number)))
        for number, maker in enumerate(chosen, 1)
    ]


@dataclass(frozen=True)
class _Maker:
    """What devices of a FAMILY share, as logarithms: the `costs` of each chip's stages (chips, stages) and
    the `residuals` of configurations (configurations,).
    """

    family: Family
    costs: NDArray[np.float64]
    residuals: NDArray[np.float64]

    @classmethod
    def draw(cls, family: Family, front: Sequence[Configuration], random: np.random.Generator) -> "_Maker":
        common = random.normal(0.0, FAMILY_COST, len(STAGES))
        own = random.normal(0.0, CHIP_COST, (len(family.chips), len(STAGES)))
        return cls(family, common + own, random.normal(0.0, FAMILY_RESIDUAL, len(front)))


def _device(
    number: int, maker: _Maker, front: Sequence[Configuration], random: np.random.Generator
) -> SimulatedDevice:
    family = maker.family
    chip = int(random.integers(len(family.chips)))
    middle = (len(family.chips) - 1) / 2
    level = math.log(family.level) + random.normal(0.0, family.spread) - YOUNGER * (chip - middle)
    releases = int(random.integers(1, 1 + len(family.drivers)))
    installations = int(random.integers(1, 1 + MOST_INSTALLATIONS))
    costs = np.exp(maker.costs[chip] + random.normal(0.0, DEVICE_COST, len(STAGES)))
    reference = np.array([row.seconds * stage_shares(row.parameters, row.stages) for row in front])
    fixed = family.fixed * random.lognormal(0.0, FIXED) * max(row.seconds for row in front)
    stages = reference * costs
    whole = stages.sum(axis=1) + fixed
    logs = (
        (np.log(whole) + level + maker.residuals)[None, None, :]
        + random.normal(0.0, DEVICE_RESIDUAL, len(front))
        + random.normal(0.0, RELEASE_GAIN, (releases, 1, len(front)))
        + random.normal(0.0, INSTALLATION, (1, installations, 1))
    )
    points = [configuration.name for configuration in front if not configuration.probe]
    return SimulatedDevice(
        name=f"{family.form} {number} ({family.name}-like)",
        family=family,
        descriptions=_descriptions(number, family, chip, releases),
        seconds=np.exp(logs),
        shares=stages / whole[:, None],
        noise=float(random.uniform(0.02, 0.08)),
        throttling=float(random.uniform(0.1, 0.6)) if random.random() < family.throttles else 0.0,
        failing=str(random.choice(points)) if random.random() < FAILING else "",
    )


def _descriptions(number: int, family: Family, chip: int, releases: int) -> tuple[dict[str, Any], ...]:
    """What the device says of itself under each of its RELEASES of driver and system."""
    handheld = bool(family.socs)
    return tuple(
        {
            "os": family.os,
            "os_version": family.os_versions[min(release, len(family.os_versions) - 1)],
            "manufacturer": MAKER,
            "model": f"{family.form} {number} ({family.name}-like)",
            "soc_model": family.socs[chip] if handheld else None,
            "cpu": None if handheld else family.cpus[chip],
            "opencl_platform": family.platform,
            "opencl_device": family.chips[chip],
            "opencl_driver": family.drivers[release],
        }
        for release in range(releases)
    )
