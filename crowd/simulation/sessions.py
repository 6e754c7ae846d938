"""Simulated sessions of simulated devices, as parts of submissions. Pure, by seed."""

import hashlib
import math
import uuid
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from crowd.simulation.devices import Configuration, SimulatedDevice
from crowd.simulation.stages import STAGES, frame_stages, period
from wire.protocol import MOST_RUNS

FIRST_TRACKED = 4
SLOW_FRAME_SHARE, SLOW_FRAME_FACTOR = 0.01, 1.8  # of the frames take longer, by this factor
SAMPLE_SECONDS = 1.0
HOT_SHARE = 0.5  # of the sessions of a throttling device
START_TEMPERATURE, TEMPERATURE_RISE = 31.0, 16.0  # degrees Celsius
CLOCK_MHZ = 2400.0
EMPTY_FRAME_US = 300
DEVIATION_SHARE = 0.2  # of the band: the deviation of a simulated trajectory
LOST = "tracking was lost in more than half of the frames"
REFUSED = "the driver refused to build the program: CL_OUT_OF_RESOURCES"


def run_order(
    protocol: Mapping[str, Any], front: Sequence[Configuration], every: bool, backend: str = "opencl"
) -> list[str]:
    """The configurations of the runs in order: the protocol's, or `every` one of `backend` except probes.

    They run forwards and backwards until each has its repeats, so that a steady drift cancels. At most
    MOST_RUNS runs.
    """
    repeats = protocol["repeats"]
    names = [row.name for row in front if not row.probe and backend in row.backends]
    names = names[: MOST_RUNS // repeats]
    forwards = names if every else list(protocol["order"])
    rounds = repeats // forwards.count(forwards[0])
    return [name for number in range(rounds) for name in (forwards[::-1] if number % 2 else forwards)]


def session(
    device: SimulatedDevice,
    installation: int,
    release: int,
    front: Sequence[Configuration],
    manifest: Mapping[str, Any],
    every: bool,
    started_at: datetime,
    random: np.random.Generator,
) -> dict[str, Any]:
    """A session of `installation` on `device` with `release` of its driver, by the protocol of `manifest`.

    `every`: with all configurations.
    """
    protocol = manifest["protocol"]
    frames, places = protocol["frames"], {row.name: index for index, row in enumerate(front)}
    backend = device.backend(installation)
    names = run_order(protocol, front, every, backend)
    today = random.normal(0.0, 0.02)
    throttling = device.throttling if random.random() < HOT_SHARE else 0.0
    seen: dict[str, int] = {}
    runs, elapsed = [], 0.0
    for order, name in enumerate(names):
        row = front[places[name]]
        slowed = 1.0 + throttling * order / max(len(names) - 1, 1)
        level = float(device.seconds[release, installation, places[name]]) * math.exp(today) * slowed
        left_out = _left_out(row.skipped or 0.0, frames)
        computed = (1.0 - left_out) / (1.0 - left_out.mean())
        stages = frame_stages(row.parameters, level * device.shares[places[name]], frames) * computed
        rest = level * (1.0 - float(device.shares[places[name]].sum())) * computed
        runs.append(_run(device, row, seen.get(name, 0), order, stages, rest, random))
        seen[name] = seen.get(name, 0) + 1
        elapsed += level * frames + float(protocol.get("rest_seconds") or 0)
    return {
        "id": _uuid(random),
        "started_at": started_at.isoformat(),
        "application": manifest["application"],
        "front_version": manifest["front_version"],
        "protocol_version": protocol["version"],
        "backend": backend,
        "empty_frame_us": EMPTY_FRAME_US,
        "stage_clock": "wall",
        "samples": _samples(throttling, elapsed, random),
        "runs": runs,
    }


def _run(
    device: SimulatedDevice,
    row: Configuration,
    repeat: int,
    order: int,
    stages: NDArray[np.float64],
    rest: NDArray[np.float64],
    random: np.random.Generator,
) -> dict[str, Any]:
    """A run whose frames take `stages` (stages, frames) and `rest` (frames,) seconds; 0 where left out.

    The configuration that fails on `device` loses the camera or does not start.
    """
    frames = stages.shape[1]
    run: dict[str, Any] = {
        "id": _uuid(random), "configuration": row.name, "repeat": repeat, "order": order, "status": "ok",
        "failure": None,
    }  # fmt: skip
    if row.name == device.failing:
        refused = row.errors.ate_max < 0.02
        return run | {"status": "failed", "failure": REFUSED if refused else LOST, "frame_us": []}
    slowed = np.where(random.random(frames) < SLOW_FRAME_SHARE, SLOW_FRAME_FACTOR, 1.0)
    slowed *= random.lognormal(0.0, device.noise, frames)
    stages_us = np.maximum(np.rint(stages * slowed * 1e6), 1).astype(np.int64)
    # The same program gives the same trajectory on each device.
    trajectory = hashlib.sha256(f"{device.name} {row.name}".encode())
    deviation = row.band * DEVIATION_SHARE
    # No error can differ from that of the reference by more than twice the deviation.
    farther = deviation * float(np.random.default_rng(list(trajectory.digest()[:4])).uniform(-1.0, 1.0))
    errors = {name: max(0.0, error + farther) for name, error in asdict(row.errors).items()}
    return run | {
        "frame_us": (stages_us.sum(axis=0) + np.rint(rest * slowed * 1e6)).astype(np.int64).tolist(),
        "stages_us": {name: series.tolist() for name, series in zip(STAGES, stages_us, strict=True)},
        "tracked": _tracked(row.parameters, rest == 0),
        **{name: round(error, 6) for name, error in errors.items()},
        "deviation": round(deviation, 6),
    }


def _left_out(share: float, frames: int) -> NDArray[np.bool_]:
    """The frames that are left out, `share` of those that are tracked, evenly."""
    number = np.arange(frames) - FIRST_TRACKED
    left_out: NDArray[np.bool_] = (number >= 0) & (np.floor((number + 1) * share) > np.floor(number * share))
    return left_out


def _tracked(parameters: Mapping[str, Any], left_out: NDArray[np.bool_]) -> list[bool | None]:
    every = period(parameters, "tracking")
    return [
        True if n >= FIRST_TRACKED and n % every == 0 and not skipped else None
        for n, skipped in enumerate(left_out.tolist())
    ]


def _samples(throttling: float, seconds: float, random: np.random.Generator) -> list[dict[str, Any]]:
    """The state of the device over `seconds`: it warms up, and with `throttling` its clock falls."""
    count = int(min(max(seconds / SAMPLE_SECONDS, 8), 200))
    course = np.linspace(0.0, 1.0, count)
    heat = START_TEMPERATURE + TEMPERATURE_RISE * (1.0 + throttling) * (1.0 - np.exp(-2.5 * course))
    clock = CLOCK_MHZ / (1.0 + throttling * course)
    return [
        {
            "t": round(float(t), 1),
            "temperature_c": round(float(t_c + random.normal(0.0, 0.3)), 1),
            "cpu_mhz": round(float(mhz)),
            "battery": None,
        }
        for t, t_c, mhz in zip(course * max(seconds, count * SAMPLE_SECONDS), heat, clock, strict=True)
    ]


def _uuid(random: np.random.Generator) -> str:
    return str(uuid.UUID(bytes=random.bytes(16), version=4))
