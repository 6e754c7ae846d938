"""Runs one kernel on NumPy arrays, wherever plans are executed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from slam.devices.layout import Layout
from slam.kfusion.declarations import (
    ADAPTIVE_KERNELS,
    ADAPTIVE_MEMBERS,
    MEMBERS,
    VIEW_KERNELS,
    constants_of,
    kernels_of,
)
from slam.plans.execution import Execution
from slam.plans.plan import STATE, Buffer, Dispatch, Plan, Value

Grid = tuple[tuple[int, ...], tuple[int, ...]]


def launcher(layout: Layout, prepare: Callable[[Plan], Execution]) -> Callable[..., None]:
    """launch(kernel, grid, **arguments): a plan of one dispatch, executed by the result of `prepare`.

    Arrays (planes, ...) travel to the device and, where the kernel writes them, back. `grid` is the global
    and the local size.
    """

    def launch(name: str, grid: Grid, **arguments: Any) -> None:
        kernels, members = kernels_of(layout), MEMBERS
        optional = ADAPTIVE_KERNELS + VIEW_KERNELS
        if name in {kernel.name for kernel in optional}:
            kernels, members = kernels + optional, members + ADAPTIVE_MEMBERS
        kernel = next(kernel for kernel in kernels if kernel.name == name)
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
            layout=layout.kind,
            configuration={},
            scene={},
            constants=constants_of(layout),
            state=members,
            initial={},
            buffers=tuple(buffers),
            kernels=kernels,
            dispatches=(Dispatch(name, "test", *grid, values),),
            input="",
        )
        execution = prepare(plan)
        arrays = {p.name: (p, arguments[p.name]) for p in kernel.parameters if p.access is not None}
        for buffer, (parameter, array) in arrays.items():
            execution.write(buffer, array if buffer == STATE else array.reshape(parameter.planes, -1))
        execution.run(0)
        for buffer, (parameter, array) in arrays.items():
            if parameter.access != "read":
                array[...] = execution.read(buffer).reshape(array.shape)

    return launch
