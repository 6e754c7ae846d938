"""Golden vectors: the input and output of each kernel, for executors in other languages.

    FRONTRUNNER_VECTORS=DIR python -m pytest tests/slam/conformance

writes one JSON file for each launch on the first OpenCL device in the layout by pixels, whose results these
tests compare with NumPy: {"plan", "inputs": {buffer: base64}, "outputs": {buffer: base64}}. The plan has one
dispatch. Arrays are little-endian, planes one after another; the state is one struct. WGSL comes from
`slam.plans.declarations.shader`.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slam.plans.plan import Plan


def encoded(arrays: Mapping[str, np.ndarray[Any, Any]]) -> dict[str, str]:
    """`arrays` by name as base64."""
    return {
        name: base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
        for name, array in arrays.items()
    }


def decoded(texts: Mapping[str, str], plan: Plan) -> dict[str, np.ndarray[Any, Any]]:
    """The buffers of `plan` that `texts` hold: (planes, count), the state ()."""
    found = {}
    for name, text in texts.items():
        buffer = plan.buffer(name)
        raw = base64.b64decode(text)
        if buffer.type == "state":
            found[name] = np.frombuffer(raw, plan.state_type)[0].copy()
        else:
            found[name] = np.frombuffer(raw, buffer.numpy_type).reshape(buffer.planes, -1).copy()
    return found


def write(
    folder: Path,
    plan: Plan,
    inputs: Mapping[str, np.ndarray[Any, Any]],
    outputs: Mapping[str, np.ndarray[Any, Any]],
) -> Path:
    """The next file of this kernel in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    kernel = plan.dispatches[0].kernel
    path = folder / f"{kernel}-{len(list(folder.glob(f'{kernel}-*.json')))}.json"
    content = {"plan": plan.to_dict(), "inputs": encoded(inputs), "outputs": encoded(outputs)}
    path.write_text(json.dumps(content), encoding="utf-8")
    return path
