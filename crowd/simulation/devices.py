"""Simulated devices: their descriptions and their times of each configuration. Pure, by seed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd.simulation.families import FAMILIES, Family
from crowd.simulation.stages import STAGES, stage_shares
from wire.front import DEFAULT, Errors

# Standard deviations of the log cost of a stage, relative to the reference device: between makers, between
# the chips of a maker, and between devices with one chip. Measured devices: 0.2 to 0.7 in total
# (docs/research/device-map.md).
FAMILY_COST, CHIP_COST, DEVICE_COST = 0.3, 0.2, 0.1
# Standard deviations of the log time of a configuration that the stages do not explain, in a family and on a
# device; and between installations of one model.
FAMILY_RESIDUAL, DEVICE_RESIDUAL, INSTALLATION_SPREAD = 0.03, 0.03, 0.03
FIXED_SPREAD = 0.35  # standard deviation of the log of the fixed time, within a family
MAX_INSTALLATIONS = 5
# Of the devices measure every configuration, on enough installations that agree. Of installations on devices
# with a browser, that share measures there, and takes that much longer. On that share of devices the
# participants agree to show the model.
THOROUGH_SHARE, LEAST_THOROUGH = 0.3, 3
BROWSER_SHARE, BROWSER_FACTOR = 0.4, 1.3
AGREEING_SHARE = 0.8
BROWSER_VERSIONS = ("141", "142", "143")  # with each release of the driver
FAILING_SHARE = 0.08  # of the devices fail, at one configuration each
RELEASE_GAIN = 0.05  # standard deviation of the effect of a new driver on a configuration
CHIP_GAIN = 0.25  # decrease of log time from one chip of a family to the next
MAKER = "Simulated"
LISTS = (("configurations", False), ("probes", True))
USUAL_SECONDS = 0.02


@dataclass(frozen=True)
class Configuration:
    """A configuration of the front: reference seconds per frame, and the errors of its reference trajectory.

    `band`: the band (m) around the reference trajectory. `stages`: reference times of the stages. A `probe`
    is only measured on request. `backends`: those that can run it. `skipped`: the share of frames that it
    leaves out; None if it computes all.
    """

    name: str
    parameters: Mapping[str, Any]
    seconds: float
    errors: Errors
    band: float
    stages: Mapping[str, float]
    probe: bool = False
    backends: tuple[str, ...] = ("opencl", "webgpu")
    skipped: float | None = None


@dataclass(frozen=True)
class SimulatedDevice:
    """A device model.

    `seconds` per frame, by release of its driver, installation and configuration. `shares` of the stages in
    that. Their sum is below 1: the rest is fixed time that no configuration saves.
    """

    name: str
    family: Family
    descriptions: tuple[dict[str, Any], ...]  # one a release, oldest first
    browser_descriptions: tuple[dict[str, Any], ...]  # the same by a browser
    browsers: tuple[bool, ...]  # for each installation, whether it measures in a browser
    thorough: bool  # whether it measures every configuration
    shows_model: bool  # whether its participants agree to that
    seconds: NDArray[np.float64]  # (releases, installations, configurations)
    shares: NDArray[np.float64]  # (configurations, stages)
    noise: float  # standard deviation of the logarithm, frame by frame
    throttling: float  # relative slowdown at the end of a long session; 0: none
    failing: str  # the configuration that fails there; "": none

    @property
    def installations(self) -> int:
        return int(self.seconds.shape[1])

    def backend(self, installation: int) -> str:
        return "webgpu" if self.browsers[installation] else "opencl"

    def description(self, installation: int, release: int) -> dict[str, Any]:
        """What `installation` sends with `release` of the driver or browser."""
        return (self.browser_descriptions if self.browsers[installation] else self.descriptions)[release]


def read_configurations(front: Mapping[str, Any]) -> tuple[Configuration, ...]:
    """The configurations of `front`, a manifest or a front with probes.

    A configuration without a predicted time or error gets a typical one. Its errors are those of the
    reference trajectory, else made up around that on the sequence which clients measure, or a predicted one.
    """
    sequence = front["sequence"]["name"]
    rows = [(row, probe) for kind, probe in LISTS for row in front.get(kind, ())]
    default = next((row["predicted"].get("runtime") for row, _ in rows if row["name"] == DEFAULT), None)
    return tuple(
        Configuration(
            row["name"],
            row["parameters"],
            (default or USUAL_SECONDS) * row["predicted"]["on_sequence"]["runtime_ratio"],
            _errors_on(sequence, row),
            row["band"],
            row["predicted"]["on_sequence"]["stages"],
            probe,
            tuple(row.get("backends") or ("opencl", "webgpu")),
            row.get("skipped"),
        )
        for row, probe in rows
    )


def _errors_on(sequence: str, row: Mapping[str, Any]) -> Errors:
    if reference := row.get("reference_ate"):
        return Errors(**reference)
    there = (one["ate_max"] for one in row.get("learned_on", ()) if one["sequence"] == sequence)
    largest: float = next(there, row["predicted"].get("ate_max")) or 0.01
    return Errors(largest, 0.4 * largest, 0.5 * largest)


def devices(count: int, front: Sequence[Configuration], seed: int) -> list[SimulatedDevice]:
    """`count` devices with their times on `front`, determined by `seed`. Their models do not depend on
    `front`.

    Raises ValueError for a `count` below 1.
    """
    if count < 1:
        raise ValueError(f"{count} devices: simulate 1 or more")
    random = np.random.default_rng((seed, 0))
    shares = np.array([family.share for family in FAMILIES])
    chosen = random.choice(len(FAMILIES), size=count, p=shares / shares.sum())
    makers = [
        _Maker.draw(family, front, np.random.default_rng((seed, number, 2)))
        for number, family in enumerate(FAMILIES)
    ]
    return [
        _device(number, makers[maker], front, np.random.default_rng((seed, number)))
        for number, maker in enumerate(chosen, 1)
    ]


@dataclass(frozen=True)
class _Maker:
    """What devices of a family share, as logarithms.

    `costs` of the stages of each chip (chips, stages), `residuals` of configurations (configurations,).
    """

    family: Family
    costs: NDArray[np.float64]
    residuals: NDArray[np.float64]

    @classmethod
    def draw(cls, family: Family, front: Sequence[Configuration], random: np.random.Generator) -> "_Maker":
        common = random.normal(0.0, FAMILY_COST, len(STAGES))
        chip_costs = random.normal(0.0, CHIP_COST, (len(family.chips), len(STAGES)))
        return cls(family, common + chip_costs, random.normal(0.0, FAMILY_RESIDUAL, len(front)))


def _device(
    number: int, maker: _Maker, front: Sequence[Configuration], random: np.random.Generator
) -> SimulatedDevice:
    family = maker.family
    chip = int(random.integers(len(family.chips)))
    middle = (len(family.chips) - 1) / 2
    level = math.log(family.level) + random.normal(0.0, family.spread) - CHIP_GAIN * (chip - middle)
    releases = int(random.integers(1, 1 + len(family.drivers)))
    thorough = bool(random.random() < THOROUGH_SHARE)
    installations = int(random.integers(LEAST_THOROUGH if thorough else 1, 1 + MAX_INSTALLATIONS))
    browsers = random.random(installations) < (BROWSER_SHARE if family.adapters else 0.0)
    costs = np.exp(maker.costs[chip] + random.normal(0.0, DEVICE_COST, len(STAGES)))
    reference = np.array([row.seconds * stage_shares(row.parameters, row.stages) for row in front])
    fixed = family.fixed * random.lognormal(0.0, FIXED_SPREAD) * max(row.seconds for row in front)
    stages = reference * costs
    whole = stages.sum(axis=1) + fixed
    logs = (
        (np.log(whole) + level + maker.residuals)[None, None, :]
        + random.normal(0.0, DEVICE_RESIDUAL, len(front))
        + random.normal(0.0, RELEASE_GAIN, (releases, 1, len(front)))
        + random.normal(0.0, INSTALLATION_SPREAD, (1, installations, 1))
        + math.log(BROWSER_FACTOR) * browsers[None, :, None]
    )
    points = [configuration.name for configuration in front if not configuration.probe]
    return SimulatedDevice(
        name=f"{family.form} {number} ({family.name}-like)",
        family=family,
        descriptions=_descriptions(number, family, chip, releases),
        browser_descriptions=_browser_descriptions(number, family, chip, releases) if family.adapters else (),
        browsers=tuple(browsers.tolist()),
        thorough=thorough,
        shows_model=bool(random.random() < AGREEING_SHARE),
        seconds=np.exp(logs),
        shares=stages / whole[:, None],
        noise=float(random.uniform(0.02, 0.08)),
        throttling=float(random.uniform(0.1, 0.6)) if random.random() < family.throttles else 0.0,
        failing=str(random.choice(points)) if random.random() < FAILING_SHARE else "",
    )


def _descriptions(number: int, family: Family, chip: int, releases: int) -> tuple[dict[str, Any], ...]:
    """The description of the device for each of `releases` of driver and operating system."""
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


def _browser_descriptions(
    number: int, family: Family, chip: int, releases: int
) -> tuple[dict[str, Any], ...]:
    """What a browser sends on the device, for each of `releases`. It names a family of chips."""
    vendor, architecture = family.adapters[chip]
    return tuple(
        {
            "os": family.os,
            "os_version": family.os_versions[min(release, len(family.os_versions) - 1)],
            "manufacturer": MAKER,
            "model": f"{family.form} {number} ({family.name}-like)",
            "browser": "Chrome",
            "browser_version": BROWSER_VERSIONS[release],
            "gpu_vendor": vendor,
            "gpu_architecture": architecture,
        }
        for release in range(releases)
    )
