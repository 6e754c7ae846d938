"""Sessions with made-up times, for what happens to a session after it was measured."""

import random
import uuid
from types import SimpleNamespace
from typing import Any

from msgspec.structs import replace

from client_kit.delivery.manifest import Manifest
from client_kit.measuring import session
from client_kit.measuring.measurement import Task
from client_kit.measuring.session import Run, Session
from wire.session import Sample

STAGES = ("preprocessing", "tracking", "integration", "raycasting")


# The device of these sessions, and what it says of itself.
DEVICE = SimpleNamespace(
    label="a GPU",
    name="a GPU",
    platform="a platform",
    backend="opencl",
    threads=None,
    max_allocation=2**40,
    global_memory=2**40,
    kind="gpu",
    handle=None,
)
IDENTITY: dict[str, str | None] = {"opencl_device": "a GPU", "opencl_platform": "a platform", "os": "Linux"}


def runs(asked: Manifest, plan: tuple[str, ...], seed: int = 0) -> tuple[Run, ...]:
    """Runs of `plan` with plausible times: the default takes 40 ms a frame, everything else 10."""
    chance, frames = random.Random(seed), asked.protocol.frames
    made: list[Run] = []
    for order, name in enumerate(plan):
        mean = 40_000 if name == "default" else 10_000
        stages = {
            stage: [round(chance.gauss(mean / 4, mean / 80)) for _ in range(frames)] for stage in STAGES
        }
        times = [sum(parts) for parts in zip(*stages.values(), strict=True)]
        run = Run(
            uuid.uuid4(), name, plan[:order].count(name), order, "ok", times, None, stages,
            [None] * 4 + [True] * (frames - 4), 0.0002, 0.0001, 0.00015,
            cpu_us=round(1.1 * sum(times)), waited_us=round(0.001 * sum(times)), deviation=0.0001,
        )  # fmt: skip
        made.append(run)
    return tuple(made)


def measured(asked: Manifest, plan: tuple[str, ...] = (), seed: int = 0) -> Session:
    """A session of `plan`, of the protocol's own order where it is empty."""
    made = runs(asked, plan or asked.plan(), seed)
    return replace(
        session.begin(asked, "opencl", None),
        runs=made,
        samples=[Sample(0.0, 41.5, 2400.0, None)],
        empty_frame_us=200.0,
        stage_clock="device",
    )


def measure(task: Task, *_: Any) -> tuple[Session, bool]:
    """In place of `measurement.measure`."""
    return measured(task.asked, task.plan), False


def payload(asked: Manifest, seed: int = 0) -> dict[str, Any]:
    """What such a session sends."""
    return session.payload(measured(asked, seed=seed), asked, {"os": "Linux", "model": "a phone"})
