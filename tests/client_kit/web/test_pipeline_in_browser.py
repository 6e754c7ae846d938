"""Executed by the browser's modules, KinectFusion gives the reference trajectories of the shipped front."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from slam.datasets import open_sequence
from slam.devices.choice import choose_device, open_session
from slam.devices.webgpu import LAYOUT
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import FOLDERS, KFusion
from slam.kfusion.plan import plan
from slam.plans.declarations import shaders
from slam.system import scene_of
from tests.client_kit.web import orders
from tests.shipped import KFUSION, LIVING_ROOM

ADAPTIVE = {
    "compute_size_ratio": 8, "volume_resolution": 128, "mu": 0.4, "icp_threshold": 0.001,
    "pyramid_iterations_fine": 2, "pyramid_iterations_middle": 9, "pyramid_iterations_coarse": 0,
    "integration_rate": 1, "skip_limit": 3, "skip_translation": 0.05, "skip_rotation": 0.03,
    "integrate_translation": 0.05, "integrate_rotation": 0.05,
}  # fmt: skip
FEW = 6  # two of them tracked, which takes the software adapter a second each
RUN = (
    (
        orders.FETCH_ORDER
        + """
async ({ url, frames }) => {
    const order = await fetchOrder(url);
    const { readHeader, readFrames } = await import("/measure/pack.js");
    const { Device, requestAdapter } = await import("/measure/gpu-device.js");
    const { Processor } = await import("/measure/processor.js");
    const { WasmExecution } = await import("/measure/wasm.js");
    const { Execution } = await import("/measure/webgpu.js");
    const { positionsOf } = await import("/measure/run-record.js");
    const { viewOf, shade } = await import("/measure/picture.js");
    const images = await readFrames(await readHeader(order.header), order.chunks, frames);
    const [{ plan, shaders }] = order.configurations;
    let device, execution;
    if (order.module) {
        device = await Processor.open(order.module);
        device.threads = 1; // a page may not wait for others
        execution = await WasmExecution.create(device, plan);
    } else {
        device = await Device.open(await requestAdapter(navigator.gpu));
        execution = await Execution.create(device, plan, shaders, device.stageClock === "device");
    }
    const outcomes = [];
    for (const [number, image] of images.entries()) outcomes.push(await execution.run(number, image));
    const view = viewOf(plan);
    const [vertices, normals] = await Promise.all(
        [view.vertices, view.normals].map(async (name) => new Float32Array(await execution.read(name)))
    );
    const pixels = shade(vertices, normals, positionsOf(outcomes).at(-1));
    device.close();
    return {
        positions: positionsOf(outcomes),
        tracked: outcomes.at(-1).state.tracked,
        skipped: outcomes.map(({ skipped }) => Boolean(skipped)),
        stages: outcomes.map(({ stages }) => stages),
        seconds: outcomes.map(({ seconds }) => seconds),
        seen: pixels.filter((value, index) => index % 4 === 0 && value !== 22).length / (pixels.length / 4),
    };
}"""
    )
    .replace("async ({ url", "return await (async ({ url")
    .join(["async (given) => {", ")(given); }"])
)

# The launches of each frame. Frame 5 is dark: its pose is refused.
COUNT = """async ({ plan, shaders, url }) => {
    const { Device, requestAdapter } = await import("/measure/gpu-device.js");
    const { Execution } = await import("/measure/webgpu.js");
    let launches = 0;
    const launch = GPUComputePassEncoder.prototype.dispatchWorkgroups;
    GPUComputePassEncoder.prototype.dispatchWorkgroups = function (...groups) {
        launches += 1;
        return launch.apply(this, groups);
    };
    const image = new Uint16Array(await (await fetch(url)).arrayBuffer());
    const device = await Device.open(await requestAdapter(navigator.gpu));
    const execution = await Execution.create(device, plan, shaders);
    const counts = [];
    const tracked = [];
    for (let number = 0; number < 8; number++) {
        launches = 0;
        const { state } = await execution.run(number, number === 5 ? image.slice().fill(0) : image);
        counts.push(launches);
        tracked.push(state.tracked);
    }
    device.gpu.destroy();
    GPUComputePassEncoder.prototype.dispatchWorkgroups = launch;
    return { counts, tracked };
}"""


def executed(
    request: pytest.FixtureRequest, web_server: Any, place: str, configuration: dict[str, Any], frames: int
) -> Any:
    """What RUN finds of a configuration of an order over the first frames of the living room."""
    fixture = {"webgpu": "gpu_page", "wasm": "web_page", "wasm-firefox": "firefox_page"}[place]
    page = request.getfixturevalue(fixture)
    web_server.folders["/living-room/"] = LIVING_ROOM
    web_server.documents["/order"] = orders.encoded(
        {
            "backend": place.partition("-")[0],
            "module": orders.serve_module(web_server),
            "configurations": [configuration],
            "chunks": orders.chunk_addresses(LIVING_ROOM, "/living-room/"),
        }
    )
    return page.evaluate(RUN, {"url": "/order", "frames": frames})


PLACES = ["webgpu", "wasm", "wasm-firefox"]


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("name", "within"), [("default", 0.0005), ("best", None)])
def test_the_first_frames_follow_the_reference(
    request: pytest.FixtureRequest, web_server: Any, place: str, name: str, within: float | None
) -> None:
    """All of them by WebAssembly."""
    backend = place.partition("-")[0]
    front = json.loads(KFUSION.read_text(encoding="utf-8"))
    point = next(point for point in front["configurations"] if point["name"] == name)
    trajectory = point["trajectory"] if backend == "wasm" else point["trajectory"][:FEW]
    frames, band = len(trajectory), point["band"]
    measured = orders.configuration(name, point["parameters"], LIVING_ROOM, band, trajectory, backend)

    result = executed(request, web_server, place, measured, frames)

    apart = np.linalg.norm(np.array(result["positions"]) - np.array(trajectory), axis=1)
    limit = within if within and backend == "webgpu" else band
    assert apart.max() < limit
    assert len(apart) == frames
    assert result["tracked"] == 1
    assert result["seen"] > 0.5
    assert not any(result["skipped"])
    for stages, seconds in zip(result["stages"], result["seconds"], strict=True):
        if stages is not None:
            assert list(stages) == ["preprocessing", "tracking", "integration", "raycasting"]
            assert sum(stages.values()) < seconds + 0.001


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_a_configuration_that_adapts_skips_the_frames_that_python_skips(
    request: pytest.FixtureRequest, web_server: Any, place: str
) -> None:
    backend = place.partition("-")[0]
    frames = 100 if backend == "wasm" else 14  # three of the latter are tracked
    sequence = open_sequence(LIVING_ROOM)
    # A module computes the same bits everywhere; other backends round otherwise, which decides a frame.
    device = choose_device(backend="wasm" if backend == "wasm" else "opencl")
    system = KFusion(Configuration(**ADAPTIVE), scene_of(sequence), open_session(device))
    expected = [system.process(sequence.depth(number)) for number in range(frames)]

    order = orders.configuration("adaptive", ADAPTIVE, LIVING_ROOM, 0.01, [], backend)
    result = executed(request, web_server, place, order, frames)

    assert result["skipped"] == [frame.skipped for frame in expected]
    assert sum(result["skipped"]) >= frames // 3
    apart = np.array(result["positions"]) - [frame.pose[:3, 3] for frame in expected]
    assert np.linalg.norm(apart, axis=1).max() < 0.002
    assert result["tracked"] == 1
    for skipped, stages in zip(result["skipped"], result["stages"], strict=True):
        assert not (skipped and stages and any(stages.values()))


@pytest.mark.slow
def test_a_second_attempt_is_launched_only_after_a_refusal(gpu_page: Any, web_server: Any) -> None:
    sequence = open_sequence(LIVING_ROOM)
    small = Configuration(compute_size_ratio=8, volume_resolution=64, integration_rate=4)
    made = plan(small, scene_of(sequence), LAYOUT)
    web_server.documents["/image"] = sequence.depth(0).tobytes()

    result = gpu_page.evaluate(
        COUNT, {"plan": made.to_dict(), "shaders": shaders(made, FOLDERS), "url": "/image"}
    )

    before = [made.initial_state() for _ in range(8)]
    before[6]["refusal"], before[6]["recovering"], before[7]["recovering"] = 1, 10, 9
    assert result["tracked"] == [0, 0, 0, 0, 1, 0, 1, 1]
    assert result["counts"] == [
        sum(dispatch.takes_place(number, state) for dispatch in made.dispatches)
        for number, state in enumerate(before)
    ]
    assert result["counts"][6] > result["counts"][7] > result["counts"][5] == result["counts"][4] - 2
