"""Sessions on every device of every backend, and a way to run one kernel on NumPy arrays there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from slam.devices.choice import AnySession
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import MEMBERS, constants_of, kernels_of
from slam.plans.executors import prepare
from slam.plans.plan import STATE, Buffer, Dispatch, Plan, Value
from tests.slam.backends import VECTORS, session
from tests.slam.conformance import vectors

__all__ = ["session"]

Grid = tuple[tuple[int, ...], tuple[int, ...]]


@pytest.fixture
def launch(session: AnySession) -> Callable[..., None]:
    """launch(kernel, grid, **arguments): a plan of one dispatch.

    Arrays (planes, ...) travel to the device and, where the kernel writes them, back. `grid` is the global
    and the local size.
    """

    def run(name: str, grid: Grid, **arguments: Any) -> None:
        kernel = next(kernel for kernel in kernels_of(session.layout) if kernel.name == name)
        buffers = [Buffer("state", STATE, 1)]
        values: dict[str, Value] = {}
        for parameter in kernel.parameters:
            value = arguments[parameter.name]
            if parameter.access is None:
                values[parameter.name] = value
                continue
            values[parameter.name] = parameter.name
            if parameter.type != STATE:
                count = value.size // parameter.planes
                buffers.append(Buffer(parameter.name, parameter.type, count, parameter.planes))
        assert set(arguments) == set(values)
        plan = Plan(
            system="kfusion",
            layout=session.layout.kind,
            configuration={},
            scene={},
            constants=constants_of(session.layout),
            state=MEMBERS,
            initial={},
            buffers=tuple(buffers),
            kernels=(kernel,),
            dispatches=(Dispatch(name, "test", *grid, values),),
            input="",
        )
        execution = prepare(plan, session, FOLDERS)
        arrays = {p.name: (p, arguments[p.name]) for p in kernel.parameters if p.access is not None}
        given = {name: array.copy() for name, (_, array) in arrays.items()}
        for buffer, (parameter, array) in arrays.items():
            execution.write(buffer, array if buffer == STATE else array.reshape(parameter.planes, -1))
        execution.run(0)
        for buffer, (parameter, array) in arrays.items():
            if parameter.access != "read":
                array[...] = execution.read(buffer).reshape(array.shape)
        if VECTORS:
            changed = {p.name: array for p, array in arrays.values() if p.access != "read"}
            vectors.write(Path(VECTORS), plan, given, changed)

    return run
