"""Executed by Deno, a V8 without a page, the browser's modules give the reference of the front that ships."""

from __future__ import annotations

import json
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slam.datasets import open_sequence
from slam.kfusion.pipeline import FOLDERS
from slam.plans.wasm import MODULE
from tests.client_kit.web import orders
from tests.client_kit.web.serving import WEB
from tests.shipped import KFUSION, LIVING_ROOM

DENO = Path(sysconfig.get_path("scripts")) / "deno"
FRAMES = {"wasm": 40, "webgpu": 6}  # a software adapter takes a second for each that is tracked
RUN = """
const order = JSON.parse(Deno.readTextFileSync(Deno.args[0]));
const load = (name) => import(`file://${order.web}/${name}`);
const { positionsOf } = await load("run-record.js");
const { plan, shaders } = order.configuration;
async function prepared() {
    if (order.module) {
        const { Processor } = await load("processor.js");
        const { WasmExecution } = await load("wasm.js");
        const processor = await Processor.open(Deno.readFileSync(order.module));
        processor.threads = 2;
        return WasmExecution.create(processor, plan);
    }
    const { Device, requestAdapter } = await load("gpu-device.js");
    const { Execution } = await load("webgpu.js");
    const adapter = await requestAdapter(navigator.gpu);
    return adapter && Execution.create(await Device.open(adapter), plan, shaders);
}
const execution = await prepared();
const positions = [];
if (execution) {
    const images = new Uint16Array(Deno.readFileSync(order.images).buffer);
    const pixels = images.length / order.frames;
    for (let frame = 0; frame < order.frames; frame++) {
        const outcome = await execution.run(frame, images.slice(frame * pixels, (frame + 1) * pixels));
        positions.push(...positionsOf([outcome]));
    }
}
console.log(JSON.stringify(positions));
Deno.exit(0);
"""


@pytest.mark.slow
@pytest.mark.parametrize("backend", FRAMES)
def test_deno_follows_the_reference(tmp_path: Path, backend: str) -> None:
    point = json.loads(KFUSION.read_text(encoding="utf-8"))["configurations"][0]
    sequence, frames = open_sequence(LIVING_ROOM), FRAMES[backend]
    images, script, order = (tmp_path / name for name in ("images", "run.js", "order.json"))
    images.write_bytes(b"".join(sequence.depth(frame).tobytes() for frame in range(frames)))
    script.write_text(RUN, encoding="utf-8")
    given: dict[str, Any] = {
        "web": str(WEB),
        "images": str(images),
        "frames": frames,
        "module": str(FOLDERS[0] / MODULE) if backend == "wasm" else None,
        "configuration": orders.configuration(
            "default", point["parameters"], LIVING_ROOM, point["band"], [], backend
        ),
    }
    order.write_bytes(orders.encoded(given))

    command = [DENO, "run", "--quiet", "--no-remote", "--unstable-webgpu", "--allow-all", script, order]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)

    assert done.returncode == 0, done.stderr
    positions = json.loads(done.stdout)
    if not positions:
        pytest.skip("Deno finds no WebGPU adapter here")
    apart = np.linalg.norm(np.array(positions) - np.array(point["trajectory"][:frames]), axis=1)
    assert len(positions) == frames
    assert apart.max() < point["band"]
