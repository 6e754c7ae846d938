"""A frame as data: buffers, constants, the layout of the state, and the dispatches in their order.

An executor knows nothing of the algorithm. The author of a plan knows nothing of OpenCL or WebGPU.
`schema.json` describes the JSON form.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

VERSION = 1
SKIPPING_VERSION = 2  # of a plan that leaves out frames: an executor that does not know that must refuse it
SCHEMA = Path(__file__).parent / "schema.json"
TYPES = {"f32": np.float32, "i32": np.int32, "u32": np.uint32, "u16": np.uint16, "u8": np.uint8}
STATE = "state"  # the type of the one buffer that holds what tracking keeps between frames

Number = int | float
# A buffer's name, a scalar, or four floats.
Value = str | Number | tuple[float, ...]
# The struct of the state, as it was read back: ().
State = np.ndarray[Any, np.dtype[np.void]]


@dataclass(frozen=True)
class Member:
    """`count` values of `type` in the state, one after another."""

    name: str
    type: str
    count: int = 1


@dataclass(frozen=True)
class Skipping:
    """The members of the state by which frames are left out.

    `count`: how many frames after the one whose state was read are served without any work. `poses`: for each
    of them, what the member `pose` is in its state.
    """

    count: str
    poses: str
    pose: str


@dataclass(frozen=True)
class Buffer:
    """`planes` images of `count` values of `type` each; every 32-bit word holds `fill` before the first
    frame.

    A kernel gets the planes one by one (OpenCL), or all of them in one buffer one after another (WebGPU).
    """

    name: str
    type: str
    count: int
    planes: int = 1
    fill: int = 0

    @property
    def numpy_type(self) -> np.dtype[Any]:
        """The type of its values, for a buffer that is not the state."""
        return np.dtype(TYPES[self.type])

    def nbytes(self, state_size: int) -> int:
        """Bytes of one plane, in whole 32-bit words."""
        size = state_size if self.type == STATE else self.numpy_type.itemsize
        return -(-size * self.count // 4) * 4


@dataclass(frozen=True)
class Parameter:
    """A parameter of a kernel: a buffer, or a scalar or vec4f (without `access`).

    `access` is "read", "write" (and read), or "atomic" where several work-items may write the same word.
    """

    name: str
    type: str
    access: str | None = None
    planes: int = 1


@dataclass(frozen=True)
class Kernel:
    """A kernel's name and what it takes, in this order.

    Its OpenCL code lies in `source`.cl with others, its WGSL code in `name`.wgsl.
    """

    name: str
    source: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Frames:
    """The frames from `first` to `last` (None: without end) whose number, from 0, is a multiple of `every`.

    Where `after` names a member of the state, only those before which that member was not 0 when the host
    last read the state: the host decides, without waiting.
    """

    first: int = 0
    last: int | None = None
    every: int = 1
    after: str | None = None

    def hold(self, number: int, before: State | None = None) -> bool:
        """Whether frame `number` is one of them.

        `before` is the state as last read; None: all members are 0.
        """
        if self.after is not None and (before is None or not before[self.after]):
            return False
        return (
            number >= self.first and (self.last is None or number <= self.last) and number % self.every == 0
        )


@dataclass(frozen=True)
class Dispatch:
    """One launch of `kernel` over `size` work-items in groups of `group`, with `arguments` by name.

    It takes place in the frames that any of `frames` holds. Where `flag` names a member of the state, the
    kernel returns at once unless that member is nonzero: the device decides, the host waits for nothing.
    """

    kernel: str
    stage: str
    size: tuple[int, ...]
    group: tuple[int, ...]
    arguments: Mapping[str, Value]
    frames: tuple[Frames, ...] = (Frames(),)
    flag: str | None = None

    def takes_place(self, number: int, before: State | None = None) -> bool:
        """Whether it is launched in frame `number`.

        `before` is the state as last read, as for `Frames.hold`.
        """
        return any(frames.hold(number, before) for frames in self.frames)

    @property
    def groups(self) -> tuple[int, ...]:
        """The number of groups that cover SIZE, in each direction."""
        return tuple(-(-size // group) for size, group in zip(self.size, self.group, strict=True))


@dataclass(frozen=True)
class Plan:
    """The plan of one configuration of a system for each frame of a scene.

    `input`: the buffer that takes each frame's depth image, uint16 millimetres, row by row. `state`: the
    members of the struct in the buffer of type "state", without padding; `initial` are those that do not
    start at 0. `skipping`: None where every frame is computed.
    """

    system: str
    layout: str
    configuration: Mapping[str, Number]
    scene: Mapping[str, Any]
    constants: Mapping[str, Number]
    state: tuple[Member, ...]
    initial: Mapping[str, tuple[Number, ...]]
    buffers: tuple[Buffer, ...]
    kernels: tuple[Kernel, ...]
    dispatches: tuple[Dispatch, ...]
    input: str
    skipping: Skipping | None = None

    @property
    def version(self) -> int:
        """Of the JSON form."""
        return SKIPPING_VERSION if self.skipping else VERSION

    @property
    def state_type(self) -> np.dtype[np.void]:
        """The state as NumPy reads it."""
        return np.dtype(
            [
                (member.name, TYPES[member.type], *([member.count] if member.count > 1 else []))
                for member in self.state
            ]
        )

    def initial_state(self) -> State:
        """The state before the first frame, ()."""
        state = np.zeros((), self.state_type)
        for name, values in self.initial.items():
            state[name] = values if len(values) > 1 else values[0]
        return state

    def buffer(self, name: str) -> Buffer:
        """The buffer `name`. Raises KeyError if it does not exist."""
        return {buffer.name: buffer for buffer in self.buffers}[name]

    def kernel(self, name: str) -> Kernel:
        """The kernel `name`. Raises KeyError if it does not exist."""
        return {kernel.name: kernel for kernel in self.kernels}[name]

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages of a frame in their order."""
        return tuple(dict.fromkeys(dispatch.stage for dispatch in self.dispatches))

    def served(self, state: State, number: int) -> State | None:
        """The state of the frame `number` (from 0) after the one whose state was read as `state`, () each.

        None where it is not left out.
        """
        if self.skipping is None or number >= state[self.skipping.count]:
            return None
        served = state.copy()
        pose = served[self.skipping.pose]
        served[self.skipping.pose] = state[self.skipping.poses].reshape(-1, len(pose))[number]
        return served

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; equal plans give equal text."""
        members = {name: value for name, value in _plain(asdict(self)).items() if value is not None}
        return {"version": self.version} | members

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Plan:
        """The plan that `to_dict` described. Raises ValueError for another version."""
        if document["version"] not in (VERSION, SKIPPING_VERSION):
            known = f"{VERSION} and {SKIPPING_VERSION}"
            raise ValueError(f"a plan of version {document['version']}: this program reads {known}")
        skipping = document.get("skipping")
        made = {
            "skipping": Skipping(**skipping) if skipping else None,
            "state": tuple(Member(**member) for member in document["state"]),
            "initial": {name: tuple(values) for name, values in document["initial"].items()},
            "buffers": tuple(Buffer(**buffer) for buffer in document["buffers"]),
            "kernels": tuple(
                Kernel(each["name"], each["source"], tuple(Parameter(**p) for p in each["parameters"]))
                for each in document["kernels"]
            ),
            "dispatches": tuple(_dispatch(each) for each in document["dispatches"]),
        }
        return cls(**({name: value for name, value in document.items() if name != "version"} | made))

    def to_json(self) -> str:
        """The plan as the text of a file."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"


def _dispatch(document: Mapping[str, Any]) -> Dispatch:
    arguments = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in document["arguments"].items()
    }
    frames = tuple(Frames(**each) for each in document["frames"])
    sizes = {name: tuple(document[name]) for name in ("size", "group")}
    return Dispatch(**(dict(document) | sizes | {"arguments": arguments, "frames": frames}))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value
