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

from slam.devices.webgpu import LAYOUT
from slam.kfusion.pipeline import FOLDERS
from slam.plans.declarations import shaders
from slam.plans.plan import Plan
from tests.slam.conformance import test_volume_kernels, vectors
from tests.slam.conformance.launching import launcher
from tests.slam.conformance.test_image_kernels import *  # noqa: F403
from tests.slam.conformance.test_tracking_kernels import *  # noqa: F403
from tests.slam.conformance.test_volume_kernels import *  # noqa: F403

pytestmark = pytest.mark.slow
EXECUTE = """async ({ plan, shaders, inputs, outputs }) => {
    const { Device, requestAdapter } = await import("/measure/gpu-device.js");
    const { Execution } = await import("/measure/webgpu.js");
    window.device ??= await Device.open(await requestAdapter(navigator.gpu));
    const execution = await Execution.create(window.device, plan, shaders);
    for (const [name, text] of Object.entries(inputs)) {
        execution.write(name, Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)));
    }
    await execution.run(0, null);
    const found = {};
    for (const name of outputs) {
        const bytes = new Uint8Array(await execution.read(name));
        found[name] = btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    }
    execution.destroy();
    return found;
}"""


@dataclass
class BrowserExecution:
    """A plan on the device of a page, for one run."""

    page: Any
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
        order = {
            "plan": self.plan.to_dict(),
            "shaders": shaders(self.plan, FOLDERS),
            "inputs": vectors.encoded(self.given),
            "outputs": [p.name for p in kernel.parameters if p.access in ("write", "atomic")],
        }
        self.found = vectors.decoded(self.page.evaluate(EXECUTE, order), self.plan)

    def read(self, name: str) -> np.ndarray:
        return self.found[name]


@pytest.mark.slow
def test_raycast(launch: Callable[..., None], session: SimpleNamespace) -> None:
    """One of its cases: NumPy takes seconds for each."""
    test_volume_kernels.test_raycast(launch, session, 0.6, (0.25, -0.3, 0.1))


@pytest.fixture
def session() -> SimpleNamespace:
    """What the tests ask of a device: how its kernels are laid out."""
    return SimpleNamespace(layout=LAYOUT)


@pytest.fixture
def launch(gpu_page: Any) -> Callable[..., None]:
    return launcher(LAYOUT, lambda plan: BrowserExecution(gpu_page, plan))
