"""Executed by the browser's modules, each kernel gives what its NumPy reference gives.

The tests are those of `tests.slam.conformance`, with their tolerances: only where they run differs. In each
browser one visit of a page executes the launches of all of them; each test is a row of what it answered.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from greenlet import getcurrent, greenlet

from slam.devices import wasm, webgpu
from slam.kfusion import vectors
from slam.kfusion.pipeline import FOLDERS
from slam.plans.declarations import shaders
from slam.plans.plan import Plan
from tests.browser.firefox import FirefoxPage
from tests.client_kit.web import orders
from tests.client_kit.web.conftest import PLACES
from tests.slam.conformance import (
    test_adapting_kernels,
    test_image_kernels,
    test_tracking_kernels,
    test_volume_kernels,
)
from tests.slam.conformance.launching import launcher

pytestmark = pytest.mark.slow
KERNELS = (test_adapting_kernels, test_image_kernels, test_tracking_kernels, test_volume_kernels)
# Each shader is compiled once a page.
WEBGPU = """async ({ plan, shaders }) => {
    const { Device, requestAdapter } = await import("/measure/gpu-device.js");
    const { Execution } = await import("/measure/webgpu.js");
    if (!window.device) {
        window.device = await Device.open(await requestAdapter(navigator.gpu));
        const compiled = new Map();
        const compile = window.device.pipeline.bind(window.device);
        window.device.pipeline = (name, code, kinds) => {
            if (!compiled.has(code)) compiled.set(code, compile(name, code, kinds));
            return compiled.get(code);
        };
    }
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
EXECUTE = """async (orders) => {
    const execute = async (order) => {
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
        return { found };
    };
    const answers = [];
    for (const order of orders) {
        answers.push(await execute(order).catch((error) => ({ error: String(error) })));
    }
    return answers;
}"""


@dataclass
class Place:
    """A page and what it executes plans by: WebGPU, or the module at an address."""

    name: str
    page: Any
    url: str
    module: str | None = None

    def execute(self, given: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """What the page answers to launches; to one at which it ends, the error."""
        script = EXECUTE.replace("PREPARE", WASM if self.module else WEBGPU)
        try:
            return list(self.page.evaluate(script, given))
        except Exception as error:
            self._open_again()
            if len(given) == 1:
                return [{"error": f"the page ended: {error}"}]
            return [answer for order in given for answer in self.execute([order])]

    def _open_again(self) -> None:
        if not isinstance(self.page, FirefoxPage):
            self.page = self.page.context.browser.new_page()
        self.page.goto(self.url)


@dataclass
class BrowserExecution:
    """A plan for one run, which waits until the page has executed it."""

    module: str | None
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
            **({"module": self.module} if self.module else {"shaders": shaders(self.plan, FOLDERS)}),
            "inputs": vectors.encoded(self.given),
            "outputs": [p.name for p in kernel.parameters if p.access in ("write", "atomic")],
        }
        answer = getcurrent().parent.switch(order)
        assert "found" in answer, answer
        self.found = vectors.decoded(answer["found"], self.plan)

    def read(self, name: str) -> np.ndarray:
        return self.found[name]


Outcomes = dict[str, BaseException | None]


def outcomes(tests: Mapping[str, Callable[[], None]], place: Place) -> Outcomes:
    """How each of `tests` ends, by name. What they launch at the same time travels to the page together."""
    found: Outcomes = {}

    def follow(name: str) -> None:
        try:
            tests[name]()
            found[name] = None
        except (Exception, pytest.skip.Exception) as error:
            found[name] = error

    running = {name: greenlet(follow) for name in tests}
    launches = {name: test.switch(name) for name, test in running.items()}
    while waiting := [name for name in running if name not in found]:
        answers = place.execute([launches[name] for name in waiting])
        launches = {name: running[name].switch(answer) for name, answer in zip(waiting, answers, strict=True)}
    return found


@pytest.fixture(scope="module", params=PLACES)
def place(request: pytest.FixtureRequest, web_server: Any) -> Place:
    """Chromium by WebGPU and by WebAssembly, and Firefox."""
    name = request.param
    page = {"webgpu": "gpu_page", "wasm": "web_page", "wasm-firefox": "firefox_page"}[name]
    module = None if name == "webgpu" else orders.serve_module(web_server)
    return Place(name, request.getfixturevalue(page), web_server.url, module)


@pytest.fixture(scope="module")
def table(place: Place, request: pytest.FixtureRequest) -> Outcomes:
    """How each of the tests that were chosen ends in this place, by its id."""
    layout = wasm.LAYOUT if place.module else webgpu.LAYOUT
    given = {
        "session": SimpleNamespace(layout=layout),
        "launch": launcher(layout, functools.partial(BrowserExecution, place.module)),
    }

    def here(items: Iterable[Any]) -> Iterable[Any]:
        chosen = (item for item in items if item.module is sys.modules[__name__])
        return (item for item in chosen if item.callspec.params["place"] == place.name)

    tests = {}
    for item in here(request.session.items):
        arguments = {name: value for name, value in item.callspec.params.items() if name != "place"}
        tests[item.nodeid] = functools.partial(item.obj.__wrapped__, **given, **arguments)
    return outcomes(tests, place)


@pytest.fixture
def session() -> None:
    """Asked for by the tests; `table` gives it to them."""


@pytest.fixture
def launch(table: Outcomes, request: pytest.FixtureRequest) -> BaseException | None:
    """How this test ended."""
    return table[request.node.nodeid]


def row(test: Callable[..., None]) -> Callable[..., None]:
    """A test that ends as `test` did in the table."""

    @functools.wraps(test)
    def ends(launch: BaseException | None, **_: object) -> None:
        if launch is not None:
            raise launch

    return ends


for tests_of_kernels in KERNELS:
    found = vars(tests_of_kernels).items()
    globals().update({name: row(test) for name, test in found if name.startswith("test_")})


@row
def test_raycast(launch: Callable[..., None], session: SimpleNamespace) -> None:
    """One of its cases: NumPy takes seconds for each."""
    test_volume_kernels.test_raycast(launch, session, 0.6, (0.25, -0.3, 0.1))
