"""Executed by the browser's modules, each kernel gives what its NumPy reference gives.

The tests are those of `tests.slam.conformance`, with their tolerances: only where they run differs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slam.devices import wasm, webgpu
from slam.kfusion import vectors
from slam.kfusion.pipeline import FOLDERS
from slam.plans.declarations import shaders
from slam.plans.plan import Plan
from tests.client_kit.web import orders
from tests.slam.conformance import test_volume_kernels
from tests.slam.conformance.launching import launcher
from tests.slam.conformance.test_adapting_kernels import *  # noqa: F403
from tests.slam.conformance.test_image_kernels import *  # noqa: F403
from tests.slam.conformance.test_tracking_kernels import *  # noqa: F403
from tests.slam.conformance.test_volume_kernels import *  # noqa: F403

pytestmark = pytest.mark.slow
WEBGPU = """async ({ plan, shaders }) => {
    const { Device, requestAdapter } = await import("/measure/gpu-device.js");
    const { Execution } = await import("/measure/webgpu.js");
    window.device ??= await Device.open(await requestAdapter(navigator.gpu));
    return Execution.create(window.device, plan, shaders);
}"""
# One thread: a page may not wait for others, as workers do.
WASM = """async ({ plan, module }) => {
    const { Processor } = await import("/measure/processor.js");
    const { WasmExecution } = await import("/measure/wasm.js");
    window.processor ??= await Processor.open(await (await fetch(module)).arrayBuffer());
    window.processor.threads = 1;
    return WasmExecution.create(window.processor, plan);
}"""
EXECUTE = """async (order) => {
    const execution = await (PREPARE)(order);
    for (const [name, text] of Object.entries(order.inputs)) {
        execution.write(name, Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)));
    }
    await execution.run(0, null);
    const found = {};
    for (const name of order.outputs) {
        const bytes = new Uint8Array(await execution.read(name));
        found[name] = btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    }
    execution.destroy();
    return found;
}"""


@dataclass(frozen=True)
class Place:
    """A page and what it executes plans by: WebGPU, or the module at an address."""

    page: Any
    module: str | None = None


@dataclass
class BrowserExecution:
    """A plan on a page, for one run."""

    place: Place
    plan: Plan
    given: dict[str, np.ndarray] = field(default_factory=dict)
    found: Mapping[str, np.ndarray] = field(default_factory=dict)

    def write(self, name: str, values: np.ndarray) -> None:
        data = values.tobytes()
        self.given[name] = np.frombuffer(data + b"\0" * (-len(data) % 4), np.uint8)

    def run(self, number: int) -> None:
        assert number == 0
        [dispatch] = self.plan.dispatches
        kernel = self.plan.kernel(dispatch.kernel)
        module = self.place.module
        order = {
            "plan": self.plan.to_dict(),
            **({"module": module} if module else {"shaders": shaders(self.plan, FOLDERS)}),
            "inputs": vectors.encoded(self.given),
            "outputs": [p.name for p in kernel.parameters if p.access in ("write", "atomic")],
        }
        script = EXECUTE.replace("PREPARE", WASM if module else WEBGPU)
        self.found = vectors.decoded(self.place.page.evaluate(script, order), self.plan)

    def read(self, name: str) -> np.ndarray:
        return self.found[name]


@pytest.mark.slow
def test_raycast(launch: Callable[..., None], session: SimpleNamespace) -> None:
    """One of its cases: NumPy takes seconds for each."""
    test_volume_kernels.test_raycast(launch, session, 0.6, (0.25, -0.3, 0.1))


@pytest.fixture(scope="module", params=["webgpu", "wasm", "wasm-firefox"])
def place(request: pytest.FixtureRequest, web_server: Any) -> Place:
    """Chromium by WebGPU and by WebAssembly, and Firefox."""
    if request.param == "webgpu":
        return Place(request.getfixturevalue("gpu_page"))
    module = orders.serve_module(web_server)
    page = request.getfixturevalue("firefox_page" if "firefox" in request.param else "web_page")
    return Place(page, module)


@pytest.fixture
def session(place: Place) -> SimpleNamespace:
    """What the tests ask of a device: how its kernels are laid out."""
    return SimpleNamespace(layout=wasm.LAYOUT if place.module else webgpu.LAYOUT)


@pytest.fixture
def launch(place: Place, session: SimpleNamespace) -> Callable[..., None]:
    return launcher(session.layout, lambda plan: BrowserExecution(place, plan))
