"""Made-up devices: how fast each runs each configuration, and what it says of itself. Pure, by seed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd.results.simulation.families import FAMILIES, Family

# What a parameter does to the time differs by so much between families, between devices of one, and between
# installations of one model: standard deviations of the logarithm, for a step of one deviation of it.
FAMILY_TASTE, DEVICE_TASTE, INSTALLATION = 0.05, 0.03, 0.03
FIXED = 0.35  # standard deviation of the logarithm of what no configuration saves, within a family
MOST_INSTALLATIONS = 4
FAILING = 0.08  # of the devices, at one configuration each
RELEASE_GAIN = 0.05  # standard deviation of what a new driver does to a configuration
MAKER = "Simulated"


@dataclass(frozen=True)
class Configuration:
    """A configuration of the front as the manifest has it: reference seconds a frame, reference ATE (m), and
    the band (m) around its reference trajectory in protocol 2.
    """

    name: str
    parameters: Mapping[str, Any]
    seconds: float
    ate: float
    band: float | None = None


@dataclass(frozen=True)
class SimulatedDevice:
    """One device model. `seconds` a frame by release of its driver, installation and configuration."""

    name: str
    family: Family
    descriptions: tuple[dict[str, Any], ...]  # one a release, oldest first
    seconds: NDArray[np.float64]  # (releases, installations, configurations)
    noise: float  # standard deviation of the logarithm, frame by frame
    throttling: float  # how much slower it is at the end of a long session; 0: not at all
    failing: str  # the configuration that does not run there; "": all do

    @property
    def installations(self) -> int:
        return int(self.seconds.shape[1])


def configurations_of(manifest: Mapping[str, Any]) -> tuple[Configuration, ...]:
    """The configurations of MANIFEST. One without a predicted time or error gets a usual one."""
    return tuple(
        Configuration(
            row["name"],
            row["parameters"],
            row["predicted"].get("runtime") or 0.02,
            row["predicted"].get("ate_max") or 0.01,
            row.get("band"),
        )
        for row in manifest["configurations"]
    )


def devices(count: int, front: Sequence[Configuration], seed: int) -> list[SimulatedDevice]:
    """COUNT devices on FRONT, the same for the same SEED, whose models are the same on every front. Raises
    ValueError for none at all.
    """
    if count < 1:
        raise ValueError(f"{count} devices: simulate 1 or more")
    steps = standardised([configuration.parameters for configuration in front])
    random = np.random.default_rng((seed, 0))
    shares = np.array([family.share for family in FAMILIES])
    chosen = random.choice(len(FAMILIES), size=count, p=shares / shares.sum())
    tastes = random.normal(0.0, FAMILY_TASTE, (len(FAMILIES), steps.shape[1]))
    return [
        _device(number, FAMILIES[family], tastes[family], steps, front, np.random.default_rng((seed, number)))
        for number, family in enumerate(chosen, 1)
    ]


def standardised(parameters: Sequence[Mapping[str, Any]]) -> NDArray[np.float64]:
    """PARAMETERS of n configurations as steps of one standard deviation each, (n, m): logarithms where all
    values are positive. What is no number, or the same everywhere, says nothing and is left out.
    """
    columns = []
    for name in sorted({name for row in parameters for name in row}):
        values = [row.get(name) for row in parameters]
        if not all(isinstance(value, int | float) for value in values):
            continue
        column = np.array(values, dtype=np.float64)
        column = np.log(column) if (column > 0).all() else column
        if column.std() > 0:
            columns.append((column - column.mean()) / column.std())
    return np.stack(columns, axis=1) if columns else np.zeros((len(parameters), 0))


def _device(
    number: int,
    family: Family,
    taste: NDArray[np.float64],
    steps: NDArray[np.float64],
    front: Sequence[Configuration],
    random: np.random.Generator,
) -> SimulatedDevice:
    chip = int(random.integers(len(family.chips)))
    # Later chips of a family are faster.
    level = math.log(family.level) + random.normal(0.0, family.spread) - 0.25 * (chip - 1)
    releases = int(random.integers(1, 1 + len(family.drivers)))
    installations = int(random.integers(1, 1 + MOST_INSTALLATIONS))
    own = taste + random.normal(0.0, DEVICE_TASTE, taste.shape)
    reference = np.array([configuration.seconds for configuration in front])
    fixed = family.fixed * random.lognormal(0.0, FIXED) * reference.max()
    logs = (
        (np.log(reference * np.exp(steps @ own) + fixed) + level)[None, None, :]
        + random.normal(0.0, RELEASE_GAIN, (releases, 1, len(front)))
        + random.normal(0.0, INSTALLATION, (1, installations, 1))
    )
    names = [configuration.name for configuration in front]
    return SimulatedDevice(
        name=f"{family.form} {number} ({family.name}-like)",
        family=family,
        descriptions=_descriptions(number, family, chip, releases),
        seconds=np.exp(logs),
        noise=float(random.uniform(0.02, 0.08)),
        throttling=float(random.uniform(0.1, 0.6)) if random.random() < family.throttles else 0.0,
        failing=str(random.choice(names)) if random.random() < FAILING else "",
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
