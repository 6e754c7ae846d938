"""Which executor belongs to a session."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from slam.devices import opencl
from slam.devices.wasm import WebAssemblySession
from slam.plans.execution import Execution
from slam.plans.opencl import OpenCLExecution
from slam.plans.plan import Plan
from slam.plans.wasm import WebAssemblyExecution

if TYPE_CHECKING:
    from slam.devices.choice import AnySession


def prepare(plan: Plan, session: AnySession, folders: Sequence[Path]) -> Execution:
    """`plan` on the device of `session`, with kernels from `folders`.

    Raises DeviceError where the device refuses a kernel, and DeviceMemoryError where it cannot hold a buffer.
    """
    if isinstance(session, opencl.Session):
        return OpenCLExecution(plan, session, folders)
    if isinstance(session, WebAssemblySession):
        return WebAssemblyExecution(plan, session, folders)
    from slam.plans.webgpu import WebGPUExecution  # an extra that not everyone has installed

    return WebGPUExecution(plan, session, folders)
