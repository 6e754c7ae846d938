"""The browser's modules in Deno, a V8 without a page."""

from __future__ import annotations

import json
import subprocess
import sysconfig
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slam.datasets import open_sequence
from slam.kfusion.pipeline import FOLDERS
from slam.plans.wasm import MODULE
from tests.client_kit.web import orders
from tests.client_kit.web.serving import WEB

DENO = Path(sysconfig.get_path("scripts")) / "deno"
RUN = """
import process from "node:process";
const order = JSON.parse(Deno.readTextFileSync(Deno.args[0]));
const load = (name) => import(`file://${order.web}/${name}`);
const { positionsOf } = await load("run-record.js");
const { plan, shaders } = order.configuration;
async function prepared() {
    if (order.module) {
        const { Processor } = await load("processor.js");
        const { WasmExecution } = await load("wasm.js");
        const processor = await Processor.open(Deno.readFileSync(order.module), order.threads);
        return WasmExecution.create(processor, plan);
    }
    const { Device, requestAdapter } = await load("gpu-device.js");
    const { Execution } = await load("webgpu.js");
    const adapter = await requestAdapter(navigator.gpu);
    return adapter && Execution.create(await Device.open(adapter), plan, shaders);
}
const execution = await prepared();
const positions = [];
const seconds = [];
let cpu = null;
if (execution) {
    const images = new Uint16Array(Deno.readFileSync(order.images).buffer);
    const pixels = images.length / order.frames;
    for (let frame = 0; frame < order.frames; frame++) {
        if (frame === order.first) cpu = process.cpuUsage();
        const outcome = await execution.run(frame, images.slice(frame * pixels, (frame + 1) * pixels));
        positions.push(...positionsOf([outcome]));
        if (frame >= order.first) seconds.push(outcome.seconds);
    }
    const { user, system } = process.cpuUsage(cpu);
    cpu = (user + system) / 1e6;
}
console.log(JSON.stringify({ positions, seconds, cpu }));
Deno.exit(0);
"""


@dataclass(frozen=True)
class Executed:
    """The camera's positions after each frame (m), and of the counted frames the wall seconds of each and the
    CPU seconds of all.

    All are empty where there is no adapter.
    """

    positions: list[list[float]]
    seconds: list[float]
    cpu: float | None


def execute(
    parameters: Mapping[str, Any],
    folder: Path,
    backend: str,
    frames: int,
    first_counted: int = 0,
    threads: int = 1,
) -> Executed:
    """KinectFusion with `parameters` over the first `frames` of the pack in `folder`."""
    sequence = open_sequence(folder)
    with tempfile.TemporaryDirectory() as name:
        images, script, order = (Path(name) / each for each in ("images", "run.js", "order.json"))
        images.write_bytes(b"".join(sequence.depth(frame).tobytes() for frame in range(frames)))
        script.write_text(RUN, encoding="utf-8")
        given = {
            "web": str(WEB),
            "images": str(images),
            "frames": frames,
            "first": first_counted,
            "threads": threads,
            "module": str(FOLDERS[0] / MODULE) if backend == "wasm" else None,
            "configuration": orders.configuration("", parameters, folder, 0, [], backend),
        }
        order.write_bytes(orders.encoded(given))
        command = [DENO, "run", "--quiet", "--no-remote", "--unstable-webgpu", "--allow-all", script, order]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return Executed(**json.loads(done.stdout))
