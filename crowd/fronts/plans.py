"""What a device does with each frame of a configuration, as data for clients that execute it.

A plan follows from the configuration and the sequence's camera. Its digest is its name.
"""

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from crowd.fronts import selectors, sequences
from crowd.fronts.selectors import Front, Point
from slam.datasets.pack import Pack
from slam.datasets.sequence import SequenceError as DamagedError

KFUSION = "kfusion"  # the one system whose frames are planned


class FramePlan(NamedTuple):
    """The plan's JSON, its digest, and the backends whose default limits it keeps."""

    content: str
    sha256: str
    backends: tuple[str, ...]


def of_point(front: Front, point: Point) -> FramePlan | None:
    """The plan of POINT of FRONT; None for a system without plans, and where its sequence is not here any
    more.
    """
    if front.application != KFUSION:
        return None
    try:
        return _made(front.sequence["sha256"], tuple(point.parameters.items()))
    except (sequences.SequenceError, DamagedError):
        return None


def find(sha256: str) -> str | None:
    """The JSON of a plan of a front that was ever published; None where none has this digest."""
    for front in selectors.fronts(KFUSION):
        for point in front.points:
            plan = of_point(front, point)
            if plan is not None and plan.sha256 == sha256:
                return plan.content
    return None


@lru_cache(maxsize=512)
def _made(sequence: str, parameters: tuple[tuple[str, Any], ...]) -> FramePlan:
    # Imported by the first manifest: a command that only reads tables needs none of it.
    from slam.devices import webgpu
    from slam.devices.layout import Layout
    from slam.kfusion.configuration import Configuration
    from slam.kfusion.plan import plan
    from slam.system import scene_of

    made = plan(Configuration.from_mapping(dict(parameters)), scene_of(_pack(sequence)), Layout("pixels"))
    largest = max(buffer.planes * buffer.nbytes(made.state_type.itemsize) for buffer in made.buffers)
    fits = largest <= webgpu.LIMITS["max-storage-buffer-binding-size"]
    content = made.to_json()
    return FramePlan(
        content,
        hashlib.sha256(content.encode()).hexdigest(),
        ("opencl", "webgpu") if fits else ("opencl",),
    )


def _pack(sha256: str) -> Pack:
    """The pack of the sequence with that digest. Raises sequences.SequenceError where it is not here."""
    for folder in sequences.packs():
        described: Mapping[str, Any] = sequences.described(folder)
        if described["sha256"] == sha256:
            return Pack(folder)
    raise sequences.SequenceError(f"no pack with digest {sha256}")
