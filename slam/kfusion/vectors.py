"""Golden vectors: what each kernel reads and what it writes then, for executors in other languages.

    python -m slam.kfusion.vectors [TARGET]

writes them again. TARGET is the file, by default the one that ships. It is gzipped JSON: a list of {"plan",
"inputs": {buffer: base64}, "outputs": {buffer: base64}}, one for each kernel. Each plan has one dispatch,
laid out by pixels. Arrays are little-endian, planes one after another; the state is one struct.
"""

from __future__ import annotations

import base64
import gzip
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.devices.choice import AnySession, choose_device, open_session
from slam.devices.layout import Layout
from slam.devices.tuning import wavy_wall
from slam.kfusion.configuration import Configuration
from slam.kfusion.definition import VECTORS
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import plan as make_plan
from slam.plans.executors import prepare
from slam.plans.plan import STATE, Dispatch, Frames, Kernel, Plan
from slam.system import Scene

SCENE = Scene(Camera(67.5, 67.5, 39.5, 29.5, 80, 60), 4.0, (0.5, 0.5, 0.1))
CONFIGURATION = Configuration(
    compute_size_ratio=1, volume_resolution=32, mu=0.3, integration_rate=1, skip_limit=2,
    skip_translation=0.03, skip_rotation=0.02, integrate_translation=0.03, integrate_rotation=0.03,
)  # fmt: skip
FRAMES = 8
JUMP = 6  # the first frame whose wall stands elsewhere: tracking is refused, and tried again

Arrays = dict[str, npt.NDArray[Any]]


def made(session: AnySession) -> list[dict[str, Any]]:
    """The last launch of each kernel, on the device of `session`, that changed something."""
    kept = replace(CONFIGURATION, raycast_after_fusion=1)
    return list((dict(_launches(kept, session)) | dict(_launches(CONFIGURATION, session))).values())


def _launches(configuration: Configuration, session: AnySession) -> Iterator[tuple[str, dict[str, Any]]]:
    plan = make_plan(configuration, SCENE, session.layout)
    whole = prepare(plan, session, FOLDERS)
    contents = {buffer.name: whole.read(buffer.name) for buffer in plan.buffers}
    state = next(buffer.name for buffer in plan.buffers if buffer.type == STATE)
    for number in range(FRAMES):
        depth, _ = wavy_wall(SCENE.camera, shift=number)
        if number >= JUMP:
            depth = depth // 2 + 100 * (np.arange(depth.shape[1]) // 20).astype(np.uint16)
        contents[plan.input] = depth.reshape(1, -1)
        before = contents[state][()].copy()
        for dispatch in plan.dispatches:
            if not dispatch.takes_place(number, before):
                continue
            single, kernel = _of_one(plan, dispatch)
            inputs = {buffer.name: contents[buffer.name] for buffer in single.buffers}
            outputs = launch(single, kernel, inputs, session)
            changed = any(outputs[name].tobytes() != inputs[name].tobytes() for name in outputs)
            contents |= outputs
            if changed:
                vector = {"plan": single.to_dict(), "inputs": encoded(inputs), "outputs": encoded(outputs)}
                yield kernel.name, vector


def _of_one(plan: Plan, dispatch: Dispatch) -> tuple[Plan, Kernel]:
    """`plan` with this dispatch alone and the buffers that it uses, and its kernel."""
    kernel = next(kernel for kernel in plan.kernels if kernel.name == dispatch.kernel)
    used = {str(dispatch.arguments[one.name]) for one in kernel.parameters if one.access is not None}
    buffers = tuple(buffer for buffer in plan.buffers if buffer.name in used or buffer.type == STATE)
    alone = (replace(dispatch, frames=(Frames(),)),)
    return replace(plan, dispatches=alone, buffers=buffers, input="", skipping=None), kernel


def launch(plan: Plan, kernel: Kernel, inputs: Mapping[str, npt.NDArray[Any]], session: AnySession) -> Arrays:
    """What `kernel`, the one of `plan`, writes into its buffers where they hold `inputs`."""
    execution = prepare(plan, session, FOLDERS)
    for name, values in inputs.items():
        execution.write(name, values)
    execution.run(0)
    [dispatch] = plan.dispatches
    written = (one.name for one in kernel.parameters if one.access not in (None, "read"))
    names = dict.fromkeys(str(dispatch.arguments[name]) for name in written)
    return {name: execution.read(name) for name in names}


def encoded(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, str]:
    """`arrays` by name as base64."""
    return {
        name: base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
        for name, array in arrays.items()
    }


def decoded(texts: Mapping[str, str], plan: Plan) -> Arrays:
    """The buffers of `plan` that `texts` hold: (planes, count), the state ()."""
    found: Arrays = {}
    for name, text in texts.items():
        buffer = plan.buffer(name)
        raw = base64.b64decode(text)
        if buffer.type == STATE:
            found[name] = np.frombuffer(raw, plan.state_type)[0].copy()
        else:
            found[name] = np.frombuffer(raw, buffer.numpy_type).reshape(buffer.planes, -1).copy()
    return found


def main() -> None:
    """Write them, as the first OpenCL device computes them."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else VECTORS
    vectors = made(open_session(choose_device(), Layout("pixels")))
    target.write_bytes(gzip.compress(json.dumps(vectors).encode(), mtime=0))


if __name__ == "__main__":
    main()
