"""What the page orders the worker to measure, made as the server and the page make it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slam.datasets import open_sequence
from slam.datasets.formats.pack import read_manifest
from slam.devices import wasm, webgpu
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import plan
from slam.plans.declarations import shaders
from slam.plans.wasm import MODULE
from slam.system import scene_of

# import(url) of what `serve_order` gave, with the files fetched.
FETCH_ORDER = """
async function fetchOrder(url) {
    const order = await (await fetch(url)).json();
    const bytes = (path) => fetch(path).then((answer) => answer.arrayBuffer());
    const [header, ...chunks] = await Promise.all(order.chunks.map(bytes));
    const module = order.backend === "wasm" ? await bytes(order.module) : undefined;
    return { ...order, module, header, chunks };
}
"""


def configuration(
    name: str,
    parameters: Mapping[str, Any],
    folder: Path,
    band: float,
    trajectory: list[list[float]],
    backend: str = "webgpu",
) -> dict[str, Any]:
    """A configuration of an order, over the pack in `folder`."""
    layout = wasm.LAYOUT if backend == "wasm" else webgpu.LAYOUT
    made = plan(Configuration(**parameters), scene_of(open_sequence(folder)), layout)
    given = {"name": name, "band": band, "trajectory": trajectory, "plan": made.to_dict()}
    return given if backend == "wasm" else given | {"shaders": shaders(made, FOLDERS)}


def serve_module(server: Any) -> str:
    """Serve the WebAssembly module; its address."""
    server.folders["/module/"] = FOLDERS[0]
    return f"/module/{MODULE}"


def chunk_addresses(folder: Path, prefix: str) -> list[str]:
    """The addresses of a pack's chunks, where `folder` is served as `prefix`."""
    return [f"{prefix}chunks/{chunk['sha256']}" for chunk in read_manifest(folder)["chunks"]]


def encoded(document: object) -> bytes:
    return json.dumps(document, allow_nan=False).encode()
