"""Executes a plan on a WebGPU device."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.devices.device import DeviceError
from slam.devices.webgpu import Binding, Launch, WebGPUSession
from slam.plans import declarations
from slam.plans.execution import Leaving, Outcome
from slam.plans.plan import STATE, Dispatch, Kernel, Plan

UNIFORM_FORMATS = {"f32": "f", "i32": "i", "u32": "I", "vec4f": "4f"}


class WebGPUExecution:
    """An `Execution` whose kernels are compiled from the `.wgsl` files of `folders`.

    A frame is one submission, and reading the state back its one synchronisation. The planes of a buffer lie
    one after another in one storage buffer. Raises DeviceError where the device refuses a kernel, and
    DeviceMemoryError where it cannot hold a buffer.
    """

    def __init__(self, plan: Plan, session: WebGPUSession, folders: Sequence[Path]) -> None:
        self.plan = plan
        self.stage_clock = "none"
        self._session = session
        self._state = plan.initial_state()
        self._leaving = Leaving(plan)
        filled = [buffer.name for buffer in plan.buffers if buffer.fill]
        if filled:
            raise DeviceError(f"buffers {', '.join(filled)}: WebGPU fills new memory with 0 only")
        self._buffers = {buffer.name: self._allocated(buffer.name) for buffer in plan.buffers}
        self._readback = session.readback(self._buffers[STATE].nbytes)
        self.write(STATE, self._state)
        self._launches = list(zip(plan.dispatches, self._bound(folders), strict=True))

    def run(self, number: int, image: npt.NDArray[np.uint16] | None = None) -> Outcome:
        began = perf_counter()
        if left_out := self._leaving.outcome(self._state, began, self.stage_clock):
            return left_out
        if image is not None:
            self._session.upload(self._buffers[self.plan.input].buffer, image)
        self._state = self._read_state(
            [launch for dispatch, launch in self._launches if dispatch.takes_place(number, self._state)]
        )
        return Outcome(self._state, perf_counter() - began, {})

    def read(self, name: str, first: int = 0, count: int | None = None) -> npt.NDArray[Any]:
        buffer = self.plan.buffer(name)
        if buffer.type == STATE:
            return self._read_state([])
        kind = buffer.numpy_type
        wanted = buffer.count - first if count is None else count
        # Copies take whole words.
        begin = first * kind.itemsize // 4 * 4
        end = -(-(first + wanted) * kind.itemsize // 4) * 4
        skipped = first * kind.itemsize - begin
        bound, stride = self._buffers[name], buffer.nbytes(self._state.itemsize)
        target = self._session.readback(end - begin)
        values = np.empty((buffer.planes, wanted), kind)
        for plane in range(buffer.planes):
            part = Binding(bound.buffer, plane * stride + begin, end - begin)
            values[plane] = np.frombuffer(self._session.run([], part, target), kind, wanted, skipped)
        return values

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        buffer, bound = self.plan.buffer(name), self._buffers[name]
        planes = [values] if buffer.type == STATE else values
        for index, plane in enumerate(planes):
            self._session.upload(bound.buffer, plane, index * buffer.nbytes(self._state.itemsize))

    def _read_state(self, launches: Sequence[Launch]) -> np.ndarray[Any, np.dtype[np.void]]:
        data = self._session.run(launches, self._buffers[STATE], self._readback)
        return np.frombuffer(data, self._state.dtype, 1).reshape(()).copy()

    def _allocated(self, name: str) -> Binding:
        buffer = self.plan.buffer(name)
        nbytes = buffer.planes * buffer.nbytes(self._state.itemsize)
        return Binding(self._session.buffer(nbytes, f"the buffer {name}"), 0, nbytes)

    def _bound(self, folders: Sequence[Path]) -> list[Launch]:
        """Every dispatch with its pipeline and its bindings."""
        texts = declarations.shaders(self.plan, folders)
        parts = [_packed(self.plan.kernel(dispatch.kernel), dispatch) for dispatch in self.plan.dispatches]
        distinct = list(dict.fromkeys(part for part in parts if part))
        places = dict(zip(distinct, self._session.uniforms(distinct), strict=True))
        launches = []
        for dispatch, part in zip(self.plan.dispatches, parts, strict=True):
            kernel = self.plan.kernel(dispatch.kernel)
            kinds, bindings = [], []
            for parameter in kernel.parameters:
                if parameter.access is not None:
                    kinds.append("read-only-storage" if parameter.access == "read" else "storage")
                    bindings.append(self._buffers[str(dispatch.arguments[parameter.name])])
            if part:
                kinds.append("uniform")
                bindings.append(places[part])
            pipeline = self._session.pipeline(texts[kernel.name], kernel.name, tuple(kinds))
            launches.append(Launch(pipeline, self._session.bind(pipeline, bindings), dispatch.groups))
        return launches


def _packed(kernel: Kernel, dispatch: Dispatch) -> bytes:
    """The uniform buffer of one dispatch, in whole blocks of 16 bytes; empty where the kernel has none."""
    data = b""
    for name, kind in declarations.uniforms(kernel):
        value = dispatch.arguments[name]
        numbers = value if isinstance(value, tuple) else (value,)
        data += struct.pack(f"<{UNIFORM_FORMATS[kind]}", *numbers)
    return data + b"\0" * (-len(data) % 16)
