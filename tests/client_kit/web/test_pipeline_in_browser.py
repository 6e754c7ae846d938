"""Executed by the browser's modules, KinectFusion gives the reference trajectories of the shipped front."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.client_kit.web import orders
from tests.slam.shipped import LIVING_ROOM

FRONT = Path(__file__).resolve().parents[3] / "fixtures" / "fronts" / "kfusion-4.json"
FRAMES = 6  # two of them tracked, which takes the software adapter a second each
RUN = (
    (
        orders.FETCH_ORDER
        + """
async ({ url, frames }) => {
    const order = await fetchOrder(url);
    const { readHeader, readFrames } = await import("/measure/pack.js");
    const { Device, requestAdapter } = await import("/measure/gpu-device.js");
    const { Execution } = await import("/measure/webgpu.js");
    const { positionsOf } = await import("/measure/run-record.js");
    const { viewOf, shade } = await import("/measure/picture.js");
    const images = await readFrames(await readHeader(order.header), order.chunks, frames);
    const device = await Device.open(await requestAdapter(navigator.gpu));
    const [{ plan, shaders }] = order.configurations;
    const execution = await Execution.create(device, plan, shaders, device.timestamps);
    const outcomes = [];
    for (const [number, image] of images.entries()) outcomes.push(await execution.run(number, image));
    const view = viewOf(plan);
    const [vertices, normals] = await Promise.all(
        [view.vertices, view.normals].map(async (name) => new Float32Array(await execution.read(name)))
    );
    const pixels = shade(vertices, normals, positionsOf(outcomes).at(-1));
    device.gpu.destroy();
    return {
        positions: positionsOf(outcomes),
        tracked: outcomes.at(-1).state.tracked,
        stages: outcomes.map(({ stages }) => stages),
        seconds: outcomes.map(({ seconds }) => seconds),
        seen: pixels.filter((value, index) => index % 4 === 0 && value !== 22).length / (pixels.length / 4),
    };
}"""
    )
    .replace("async ({ url", "return await (async ({ url")
    .join(["async (given) => {", ")(given); }"])
)


@pytest.mark.parametrize(("name", "within"), [("default", 0.0005), ("best", None)])
def test_the_first_frames_follow_the_reference(
    gpu_page: Any, web_server: Any, name: str, within: float | None
) -> None:
    front = json.loads(FRONT.read_text(encoding="utf-8"))
    point = next(point for point in front["configurations"] if point["name"] == name)
    trajectory = point["trajectory"][:FRAMES]
    configuration = orders.configuration(name, point["parameters"], LIVING_ROOM, point["band"], trajectory)
    web_server.folders["/living-room/"] = LIVING_ROOM
    web_server.documents["/order"] = orders.encoded(
        {"configurations": [configuration], "chunks": orders.chunk_addresses(LIVING_ROOM, "/living-room/")}
    )

    found = gpu_page.evaluate(RUN, {"url": "/order", "frames": FRAMES})

    apart = np.linalg.norm(np.array(found["positions"]) - np.array(trajectory), axis=1)
    assert apart.max() < (within or point["band"])
    assert found["tracked"] == 1
    assert found["seen"] > 0.5
    for stages, seconds in zip(found["stages"], found["seconds"], strict=True):
        if stages is not None:
            assert list(stages) == ["preprocessing", "tracking", "integration", "raycasting"]
            assert sum(stages.values()) < seconds + 0.001
