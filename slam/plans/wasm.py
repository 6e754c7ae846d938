"""Executes a plan in WebAssembly."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.devices.wasm import WebAssemblySession, aligned
from slam.plans.execution import Leaving, Outcome, Segment, segments
from slam.plans.plan import STATE, Dispatch, Plan

MODULE = "kernels.wasm"  # in a system's folder of kernels: `slam.plans.wasm_module.build` makes it
WORD = 4  # bytes of a number, an address, and of each part of a vector


class WebAssemblyExecution:
    """An `Execution` whose kernels are those of the module in the first of `folders`.

    Buffers, launches and lists of launches lie in the module's memory. The launches of a stage are one call.
    Raises DeviceError where the module cannot be compiled, and DeviceMemoryError where memory ends.
    """

    def __init__(self, plan: Plan, session: WebAssemblySession, folders: Sequence[Path]) -> None:
        self.plan = plan
        self.stage_clock = "wall"
        self._state = plan.initial_state()
        self._leaving = Leaving(plan)
        self._places: dict[str, list[int]] = {}
        end = session.first_free
        for buffer in plan.buffers:
            stride = aligned(buffer.nbytes(self._state.itemsize))
            self._places[buffer.name] = [end + plane * stride for plane in range(buffer.planes)]
            end += buffer.planes * stride
        launches: dict[int, list[int]] = {}  # the words at each address
        self._segments: list[tuple[Segment, int]] = []
        for segment in segments(plan):
            addresses = []
            for dispatch in segment.dispatches:
                addresses.append(end)
                launches[end] = words = self._launch(dispatch)
                end = aligned(end + WORD * len(words))
            self._segments.append((segment, end))
            launches[end] = addresses
            end = aligned(end + WORD * len(addresses))
        self._machine = session.machine(folders[0] / MODULE, end)
        for address, words in launches.items():
            self._view(address, np.uint32, len(words))[:] = words
        for buffer in plan.buffers:
            if buffer.fill:
                for address in self._places[buffer.name]:
                    words_of = buffer.nbytes(self._state.itemsize) // WORD
                    self._view(address, np.uint32, words_of)[:] = buffer.fill
        self.write(STATE, self._state)

    def run(self, number: int, image: npt.NDArray[np.uint16] | None = None) -> Outcome:
        began = perf_counter()
        if left_out := self._leaving.outcome(self._state, began, self.stage_clock):
            return left_out
        if image is not None:
            self.write(self.plan.input, image.reshape(1, -1))
        stages = dict.fromkeys(self.plan.stages, 0.0)
        for segment, launches in self._segments:
            if segment.takes_place(number, self._state):
                before = perf_counter()
                self._machine.run(launches, len(segment.dispatches))
                stages[segment.stage] += perf_counter() - before
        self._state = self.read(STATE)
        return Outcome(self._state, perf_counter() - began, stages)

    def read(self, name: str, first: int = 0, count: int | None = None) -> npt.NDArray[Any]:
        buffer, places = self.plan.buffer(name), self._places[name]
        if buffer.type == STATE:
            return self._view(places[0], self._state.dtype, 1).reshape(()).copy()
        kind = buffer.numpy_type
        wanted = buffer.count - first if count is None else count
        return np.stack([self._view(place + first * kind.itemsize, kind, wanted) for place in places])

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        buffer, places = self.plan.buffer(name), self._places[name]
        if buffer.type == STATE:
            self._view(places[0], self._state.dtype, 1)[0] = values
            return
        for place, plane in zip(places, values, strict=True):
            self._view(place, buffer.numpy_type, plane.size)[:] = plane.reshape(-1)

    def _view(self, address: int, kind: Any, count: int) -> npt.NDArray[Any]:
        """`count` values of type `kind` that lie in memory from `address` on."""
        nbytes = count * np.dtype(kind).itemsize
        return self._machine.bytes[address : address + nbytes].view(kind)

    def _launch(self, dispatch: Dispatch) -> list[int]:
        """The launch as launches.c reads it: a header of four words, then the arguments."""
        names = [kernel.name for kernel in self.plan.kernels]
        kernel = self.plan.kernel(dispatch.kernel)
        words = [names.index(kernel.name), dispatch.size[0], int(np.prod(dispatch.size)), 0]
        for parameter in kernel.parameters:
            value = dispatch.arguments[parameter.name]
            if isinstance(value, str):
                words += self._places[value]
            elif isinstance(value, tuple):
                words += np.array(value, np.float32).view(np.uint32).tolist()
            else:
                kind = np.float32 if parameter.type == "f32" else np.int32
                words.append(int(np.array(value, kind).view(np.uint32)))
        return words
