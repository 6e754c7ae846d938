"""Every WGSL text that a browser gets is compiled by naga (wgpu) and by Tint (Chromium)."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from slam.camera import Camera
from slam.devices.choice import list_devices, open_session
from slam.devices.webgpu import LAYOUT
from slam.kfusion.configuration import Configuration
from slam.kfusion.declarations import ADAPTIVE_KERNELS, kernels_of
from slam.kfusion.pipeline import FOLDERS
from slam.kfusion.plan import plan
from slam.plans.declarations import shaders
from slam.plans.executors import prepare
from slam.system import Scene
from tests.browser.chromium import NoBrowserError, launched
from tests.slam.backends import NO_WEBGPU

SMALL = Configuration(volume_resolution=32, compute_size_ratio=8, integration_rate=1, skip_limit=1)
SCENE = Scene(Camera(480.0, -480.0, 319.5, 239.5, 640, 480), 5.0, (0.5, 0.5, 0.1))
PLAN = plan(SMALL, SCENE, LAYOUT)
SHADERS = shaders(PLAN, FOLDERS)
FLAGS = ("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader")
# What a compiler says of each text, and whether a pipeline comes of it; null without an adapter.
COMPILE = """async (texts) => {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) return null;
    const device = await adapter.requestDevice();
    const found = {};
    for (const [name, code] of Object.entries(texts)) {
        const module = device.createShaderModule({ code });
        const { messages } = await module.getCompilationInfo();
        found[name] = messages.map((m) => `${m.type}, line ${m.lineNum}: ${m.message}`);
        try {
            const compute = { module, entryPoint: name };
            await device.createComputePipelineAsync({ layout: "auto", compute });
        } catch (error) {
            found[name].push(error.message);
        }
    }
    return found;
}"""


class EmptyPage(BaseHTTPRequestHandler):
    """http://localhost is a secure context, which WebGPU needs."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>WebGPU</title>")

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def tint() -> Iterator[Any]:
    """tint(texts): what Chromium's compiler says of each, none where all is well."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), EmptyPage)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        with launched(*FLAGS) as browser:
            page = browser.new_page()
            page.goto(f"http://localhost:{server.server_port}/")
            if page.evaluate(COMPILE, {}) is None:
                pytest.skip("this Chromium has no WebGPU adapter")
            yield lambda texts: page.evaluate(COMPILE, texts)
    except NoBrowserError as reason:
        pytest.skip(str(reason))
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_a_plan_launches_every_kernel():
    assert set(SHADERS) == {kernel.name for kernel in (*kernels_of(LAYOUT), *ADAPTIVE_KERNELS)}


def test_no_kernel_binds_more_storage_buffers_than_webgpu_promises():
    for kernel in PLAN.kernels:
        assert sum(parameter.access is not None for parameter in kernel.parameters) <= 8


@pytest.mark.slow
def test_naga_compiles_every_kernel():
    devices = list_devices("webgpu")
    if not devices:
        pytest.skip(NO_WEBGPU)
    prepare(PLAN, open_session(devices[0]), FOLDERS)


@pytest.mark.slow
def test_tint_compiles_every_kernel(tint):
    assert tint(SHADERS) == {name: [] for name in SHADERS}


@pytest.mark.slow
def test_tint_says_where_an_error_is(tint):
    found = tint({"solve": SHADERS["solve"].replace("workgroupUniformLoad(&wanted)", "wanted")})
    assert any("uniform control flow" in message for message in found["solve"])
