"""Executes a plan on an OpenCL device."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from slam.devices.opencl import BoundKernel, Session
from slam.plans import declarations
from slam.plans.execution import Leaving, Outcome, Segment, segments
from slam.plans.plan import STATE, Dispatch, Plan

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer, Event

CLOCK_TOLERANCE = 1.02  # how much faster than the host's a device's clock may run


class OpenCLExecution:
    """An `Execution` whose kernels are compiled from the `.cl` files of `folders`.

    Everything of a frame is enqueued at once; reading the state back is its one synchronisation. Raises
    DeviceError where the device refuses a kernel, and DeviceMemoryError where it cannot hold a buffer.
    """

    def __init__(self, plan: Plan, session: Session, folders: Sequence[Path]) -> None:
        self.plan = plan
        self.stage_clock = "device"
        self._session = session
        self._folders = folders
        self._declarations = declarations.opencl(plan)
        self._state = plan.initial_state()
        self._leaving = Leaving(plan)
        self._buffers: dict[str, list[Buffer]] = {}
        for buffer in plan.buffers:
            nbytes = buffer.nbytes(self._state.itemsize)
            self._buffers[buffer.name] = planes = [
                session.buffer(nbytes, f"the buffer {buffer.name}") for _ in range(buffer.planes)
            ]
            for plane in planes:
                session.fill(plane, nbytes, buffer.fill)
        self.write(STATE, self._state)
        self._segments: list[tuple[Segment, list[BoundKernel]]] = [
            (segment, [self._bound(dispatch) for dispatch in segment.dispatches])
            for segment in segments(plan)
        ]
        session.finish()

    def run(self, number: int, image: npt.NDArray[np.uint16] | None = None) -> Outcome:
        began = perf_counter()
        if left_out := self._leaving.outcome(self._state, began, self.stage_clock):
            return left_out
        uploaded = None
        if image is not None:
            uploaded = self._session.upload(self._buffers[self.plan.input][0], image, wait=False)
        spans: dict[str, tuple[Event, Event]] = {}
        for segment, kernels in self._segments:
            if segment.takes_place(number, self._state):
                events = [kernel() for kernel in kernels]
                first, _ = spans.get(segment.stage, (events[0], None))
                spans[segment.stage] = (first, events[-1])
        state = np.empty_like(self._state)
        self._session.download(self._buffers[STATE][0], state)
        self._state = state
        computation = perf_counter() - began
        del uploaded  # it is done: dropped earlier it would have waited
        return Outcome(state, computation, self._stages(spans, computation))

    def read(self, name: str, first: int = 0, count: int | None = None) -> npt.NDArray[Any]:
        buffer = self.plan.buffer(name)
        if buffer.type == STATE:
            state = np.empty_like(self._state)
            self._session.download(self._buffers[name][0], state)
            return state
        kind = buffer.numpy_type
        values = np.empty((buffer.planes, buffer.count - first if count is None else count), kind)
        for plane, device_buffer in zip(values, self._buffers[name], strict=True):
            self._session.download(device_buffer, plane, first * kind.itemsize)
        return values

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        planes = [values] if self.plan.buffer(name).type == STATE else values
        for plane, device_buffer in zip(planes, self._buffers[name], strict=True):
            self._session.upload(device_buffer, plane)

    def _bound(self, dispatch: Dispatch) -> BoundKernel:
        kernel = self.plan.kernel(dispatch.kernel)
        arguments: list[Any] = []
        for parameter in kernel.parameters:
            value = dispatch.arguments[parameter.name]
            if isinstance(value, str):
                arguments += self._buffers[value]
            elif isinstance(value, tuple):
                arguments.append(np.array(value, np.float32))
            else:
                arguments.append(float(value) if parameter.type == "f32" else value)
        source = next(path for folder in self._folders if (path := folder / f"{kernel.source}.cl").is_file())
        return self._session.kernel(
            source,
            kernel.name,
            dispatch.size,
            *arguments,
            group=dispatch.group,
            declarations=self._declarations,
        )

    def _stages(self, spans: dict[str, tuple[Event, Event]], computation: float) -> dict[str, float]:
        """Seconds between the first launch of each stage, or the end of the one before, and its last launch's
        end. Empty from the first frame on whose times the driver does not know, or that add up to more than
        the frame took.
        """
        if self.stage_clock == "none":
            return {}
        seconds = dict.fromkeys(self.plan.stages, 0.0)
        before = 0
        for stage, events in spans.items():
            span = self._session.span(*events)
            if span is None or span[1] < before:
                break
            seconds[stage] = 1e-9 * (span[1] - max(span[0], before))
            before = span[1]
        else:
            if sum(seconds.values()) <= CLOCK_TOLERANCE * computation:
                return seconds
        self.stage_clock = "none"
        return {}
