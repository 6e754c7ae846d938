"""A session in a browser: its runs, and what becomes of it where something fails."""

from __future__ import annotations

import re
import uuid
from collections.abc import Callable
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from client_kit.delivery.manifest import Manifest
from slam.benchmark import run
from slam.datasets import open_sequence
from tests.builders import manifests
from tests.client_kit.web import orders
from tests.client_kit.web.serving import WEB, measurement_at_any_speed
from tests.slam.tiny import FRAMES, write_tiny_pack

# Two whose trajectories hardly differ from device to device, on so small a sequence.
DEFAULT = {"compute_size_ratio": 2, "volume_resolution": 64, "mu": 0.3, "pyramid_iterations_fine": 1,
           "pyramid_iterations_middle": 2, "pyramid_iterations_coarse": 2, "tracking_rate": 2}  # fmt: skip
BEST = DEFAULT | {"tracking_rate": 1, "integration_rate": 6}
STAGES = ["preprocessing", "tracking", "integration", "raycasting"]
# What a session sends, in this order. `react(message, tools)` may stop it or lose its device.
MEASURE = """async ({ url, change, react, gpu }) => {
    FETCH_ORDER
    const { measure } = await import("/measure/measurement.js");
    const order = await fetchOrder(url);
    new Function("order", change)(order);
    const devices = [];
    const { requestDevice } = GPUAdapter.prototype;
    GPUAdapter.prototype.requestDevice = async function (...description) {
        devices.push(await requestDevice.apply(this, description));
        return devices.at(-1);
    };
    const stopping = new AbortController();
    const messages = [];
    const tools = {
        stop: () => stopping.abort(),
        lose: () => devices.at(-1).destroy(),
        count: (type) => messages.filter((message) => message.type === type).length,
    };
    const reaction = new Function("message", "tools", react);
    try {
        await measure(order, {
            gpu: new Function(`return ${gpu}`)(),
            send: (message) => {
                const picture = message.type === "picture";
                messages.push(picture ? { ...message, pixels: message.pixels.length } : message);
                reaction(message, tools);
            },
            stored: async () => messages.push({ type: "stored" }),
            signal: stopping.signal,
        });
    } finally {
        GPUAdapter.prototype.requestDevice = requestDevice;
    }
    return { messages, devices: devices.length };
}""".replace("FETCH_ORDER", orders.FETCH_ORDER)
# The same by the messages of the worker.
WORK = """async ({ url, stopIn }) => {
    FETCH_ORDER
    const order = await fetchOrder(url);
    const worker = new Worker("/measure/worker.js", { type: "module" });
    const messages = [];
    return new Promise((resolve, reject) => {
        worker.onerror = (error) => reject(new Error(error.message));
        worker.onmessage = ({ data }) => {
            messages.push(data.type === "picture" ? { ...data, pixels: data.pixels.length } : data);
            if (data.type === "done" || data.type === "failed") resolve(messages);
            if (data.type !== "run") return;
            messages.push({ type: "stored" });
            worker.postMessage({ type: "next" });
            // It waits in the queue of the worker, which has begun the next run when it reads it.
            if (data.run.order + 2 === stopIn) worker.postMessage({ type: "stop" });
        };
        worker.postMessage({ type: "measure", ...order }, [order.header, ...order.chunks]);
    });
}""".replace("FETCH_ORDER", orders.FETCH_ORDER)

Session = Callable[..., tuple[list[dict[str, Any]], int]]


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_pack(tmp_path_factory.mktemp("web"))


@pytest.fixture(scope="module")
def order(pack: Path) -> dict[str, Any]:
    """Two configurations over a tiny sequence, with the trajectories that OpenCL finds."""
    sequence = open_sequence(pack)
    configurations = []
    for name, parameters in (("default", DEFAULT), ("best", BEST)):
        report = run(parameters, sequence)
        positions = report.poses[:, :3, 3]
        assert [frame.tracked for frame in report.frames].count(False) == 0
        configurations.append(orders.configuration(name, parameters, pack, 0.005, positions.tolist()))
    return {
        "backend": "webgpu",
        "protocol": {
            "version": 2, "warmup_frames": 2, "frames": FRAMES, "first_counted_frame": 4,
            "order": ["default", "best", "best", "default"], "repeats": 2, "rest_seconds": 0, "max_ate": 0.05,
        },
        "configurations": configurations,
        "chunks": orders.chunk_addresses(pack, "/tiny/"),
        "done": [],
        "session": None,
    }  # fmt: skip


def publish(web_server: Any, pack: Path, order: dict[str, Any]) -> None:
    web_server.documents["/measure/measurement.js"] = measurement_at_any_speed().encode()
    web_server.documents["/measure/watchful.js"] = (WEB / "measurement.js").read_bytes()
    web_server.folders["/tiny/"] = pack
    web_server.documents["/order"] = orders.encoded(order)


@pytest.fixture
def published(web_server: Any, pack: Path, order: dict[str, Any]) -> None:
    publish(web_server, pack, order)


@pytest.fixture
def session(gpu_page: Any, published: None) -> Session:
    """session(change, react, gpu): the messages of a session and how many devices it opened.

    `change` and `react` are statements of JavaScript, over `order`, and over `message` and `tools`.
    """

    def measured(change: str = "", react: str = "", gpu: str = "navigator.gpu") -> Any:
        given = {"url": "/order", "change": change, "react": react, "gpu": gpu}
        found = gpu_page.evaluate(MEASURE, given)
        return found["messages"], found["devices"]

    return measured


# Whatever the device computes takes longer while `window.disturbed` is set.
DISTURB = """
    const { mapAsync } = GPUBuffer.prototype;
    window.disturbed = false;
    window.restore = () => { GPUBuffer.prototype.mapAsync = mapAsync; };
    GPUBuffer.prototype.mapAsync = async function (...asked) {
        await mapAsync.apply(this, asked);
        if (window.disturbed) await new Promise((resolve) => setTimeout(resolve, 200));
    };
"""


@pytest.mark.slow
def test_a_block_that_other_programs_disturbed_is_measured_again(gpu_page: Any, published: None) -> None:
    react = """
        if (message.phase === "measuring") window.disturbed = message.run === 2;
        if (message.type === "done") window.restore();
    """
    given = {"url": "/order", "change": DISTURB, "react": react, "gpu": "navigator.gpu"}
    watchful = MEASURE.replace("/measure/measurement.js", "/measure/watchful.js")
    messages = gpu_page.evaluate(watchful, given)["messages"]

    repeated = of(messages, "repeated")[0]
    assert [run["order"] for run in repeated["replaced"]] == [0, 1, 2, 3]
    assert [(run["configuration"], run["repeat"], run["order"]) for run in repeated["runs"]] == [
        ("default", 0, 4), ("best", 0, 5), ("best", 1, 6), ("default", 1, 7),
    ]  # fmt: skip
    assert len(runs_of(messages)) == 4
    assert (messages[-1]["type"], messages[-1]["interrupted"]) == ("done", False)


def of(messages: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    return [message for message in messages if message["type"] == kind]


def runs_of(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [message["run"] for message in of(messages, "run")]


@pytest.fixture(scope="module")
def whole(gpu_page: Any, web_server: Any, pack: Path, order: dict[str, Any]) -> list[dict[str, Any]]:
    """The messages of a session that nothing disturbs."""
    publish(web_server, pack, order)
    given = {"url": "/order", "change": "", "react": "", "gpu": "navigator.gpu"}
    return list(gpu_page.evaluate(MEASURE, given)["messages"])


@pytest.mark.slow
def test_a_session_is_measured_in_the_order_of_the_protocol(whole: list[dict[str, Any]], pack: Path) -> None:
    messages = whole

    assert messages[-1] == {"type": "done", "interrupted": False}
    [clock] = of(messages, "session")
    assert clock["empty_frame_us"] > 0
    runs = runs_of(messages)
    assert [(r["configuration"], r["repeat"], r["order"]) for r in runs] == [
        ("default", 0, 0), ("best", 0, 1), ("best", 1, 2), ("default", 1, 3),
    ]  # fmt: skip
    assert len({uuid.UUID(r["id"]) for r in runs}) == 4
    assert messages.index(clock) < messages.index(of(messages, "run")[0])
    for message in of(messages, "run"):
        assert messages[messages.index(message) + 1] == {"type": "stored"}
    for result in runs:
        parameters = DEFAULT if result["configuration"] == "default" else BEST
        report = run(parameters, open_sequence(pack))
        assert report.ate is not None
        assert (result["status"], result["failure"]) == ("ok", None)
        assert result["tracked"] == [frame.tracked for frame in report.frames]
        assert result["ate_max"] == pytest.approx(report.ate.max, abs=0.005)
        assert result["ate_mean"] <= result["ate_rmse"] <= result["ate_max"]
        assert 0 <= result["deviation"] < 0.005
        assert len(result["frame_us"]) == FRAMES
        assert all(isinstance(time, int) and time > 0 for time in result["frame_us"])
        assert ("stages_us" in result) == (clock["stage_clock"] == "device")
        if "stages_us" in result:
            assert list(result["stages_us"]) == STAGES
            sums = np.sum(list(result["stages_us"].values()), axis=0)
            assert (sums <= result["frame_us"]).all()


@pytest.mark.slow
def test_progress_and_pictures_leave_the_timed_frames_alone(whole: list[dict[str, Any]]) -> None:
    messages = whole
    progress = [m for m in of(messages, "progress") if m["phase"] != "compiling"]
    assert [m["phase"] for m in progress] == sorted(
        (m["phase"] for m in progress), key=["preparing", "checking", "measuring"].index
    )
    timed = [m for m in progress if m["phase"] == "measuring"]
    assert {(m["run"], m["runs"], m["frames"]) for m in timed} == {(n, 4, FRAMES) for n in (1, 2, 3, 4)}
    # Each tenth frame, and on a busy machine those after a second without any.
    assert {0, 10, 12} <= {m["frame"] for m in timed if m["run"] == 1}
    kinds = [m["type"] for m in messages if m.get("phase") != "preparing"]
    session_at = kinds.index("session")
    steps = [kind for kind, _ in groupby(kinds[session_at:])]
    assert steps == ["session", *["progress", "picture", "run", "stored"] * 4, "done"]
    assert kinds[:session_at].count("picture") == 4
    drawn = [(before, m) for before, m in pairwise(messages) if m["type"] == "picture"]
    assert all(before["configuration"] == m["configuration"] for before, m in drawn)
    assert {(m["width"], m["height"], m["pixels"]) for m in of(messages, "picture")} == {(80, 60, 19200)}


@pytest.mark.slow
def test_each_kernel_that_is_compiled_is_reported_before_a_check(whole: list[dict[str, Any]]) -> None:
    compiled = [m for m in of(whole, "progress") if m["phase"] == "compiling"]

    for name in ("default", "best"):
        steps = [(m["frame"], m["frames"]) for m in compiled if m["configuration"] == name]
        assert steps == [(number, len(steps)) for number in range(1, len(steps) + 1)]
        assert len(steps) > 3
    assert not [m for m in compiled if m["run"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order_of_runs", "repeats"),
    [
        (["default", "best", "best", "default"], 4),
        (["default", "best"], 3),
        (["default", "a", "b"], 2),
        (["a", "default"], 1),
    ],
)
def test_the_runs_are_those_of_the_python_client(
    web_page: Any, order_of_runs: list[str], repeats: int
) -> None:
    document = manifests.manifest()
    document["configurations"] = [manifests.configuration(name, {}) for name in sorted(set(order_of_runs))]
    document["protocol"] |= {"order": order_of_runs, "repeats": repeats}
    manifest = Manifest.parse(document)
    script = """async (protocol) => {
        const { plannedRuns } = await import("/measure/schedule.js");
        return plannedRuns(protocol).map((run) => [run.configuration, run.repeat, run.order]);
    }"""

    found = web_page.evaluate(script, {"order": order_of_runs, "repeats": repeats})

    names = list(manifest.plan())
    assert found == [[name, names[:place].count(name), place] for place, name in enumerate(names)]


@pytest.mark.slow
def test_the_worker_waits_for_each_run_to_be_stored_and_drops_the_unfinished_one_when_it_is_stopped(
    gpu_page: Any, published: None
) -> None:
    messages = gpu_page.evaluate(WORK, {"url": "/order", "stopIn": 3})

    assert [run["order"] for run in runs_of(messages)] == [0, 1]
    assert messages[-1] == {"type": "done", "interrupted": True}
    for message in of(messages, "run"):
        assert messages[messages.index(message) + 1] == {"type": "stored"}


@pytest.mark.slow
def test_a_stop_before_anything_is_timed_ends_the_session(session: Session) -> None:
    messages, _ = session(react="if (message.phase === 'preparing') tools.stop();")

    assert [m["type"] for m in messages] == ["progress", "done"]


@pytest.mark.slow
def test_a_resumed_session_keeps_its_clocks_and_makes_the_runs_that_are_left(session: Session) -> None:
    messages, _ = session(
        change="order.done = [{}, {}, {}]; order.session = { stage_clock: 'none', empty_frame_us: 12.5 };"
    )

    [clock] = of(messages, "session")
    assert (clock["backend"], clock["stage_clock"], clock["empty_frame_us"]) == ("webgpu", "none", 12.5)
    [result] = runs_of(messages)
    assert (result["configuration"], result["repeat"], result["order"]) == ("default", 1, 3)
    assert "stages_us" not in result
    assert {m["configuration"] for m in of(messages, "progress")} == {"", "default"}


@pytest.mark.slow
def test_a_session_that_has_all_its_runs_is_done(session: Session) -> None:
    messages, _ = session(change="order.done = [{}, {}, {}, {}];")

    assert [m["type"] for m in messages] == ["done"]


WITHOUT_TIMESTAMPS = """({ async requestAdapter(options) {
    const adapter = await navigator.gpu.requestAdapter(options);
    return { features: new Set(), info: adapter.info, requestDevice: () => adapter.requestDevice() };
} })"""


@pytest.mark.slow
def test_a_configuration_that_does_not_fit_fails_and_the_other_is_measured_without_timestamps(
    web_server: Any, order: dict[str, Any], pack: Path, session: Session
) -> None:
    large = orders.configuration("best", BEST | {"volume_resolution": 512}, pack, 0.005, [[0, 0, 0]] * FRAMES)
    altered = order | {"configurations": [order["configurations"][0], large]}
    web_server.documents["/order"] = orders.encoded(altered)

    messages, devices = session(gpu=WITHOUT_TIMESTAMPS)

    assert of(messages, "session")[0]["stage_clock"] == "none"
    runs = runs_of(messages)
    assert not [run for run in runs if "stages_us" in run and run["status"] == "ok"]
    assert [(r["configuration"], r["status"]) for r in runs] == [
        ("default", "ok"), ("best", "failed"), ("best", "failed"), ("default", "ok"),
    ]  # fmt: skip
    for failed in runs[1:3]:
        assert re.fullmatch(
            r"the buffer voxels needs one buffer of 512 MiB, '.+' allows at most 128 MiB", failed["failure"]
        )
        assert (failed["frame_us"], failed["tracked"], failed["ate_max"]) == ([], [], None)
        assert "deviation" not in failed
    assert messages[-1] == {"type": "done", "interrupted": False}
    assert devices == 1


@pytest.mark.slow
def test_a_lost_device_is_a_failed_run_and_another_device_goes_on(session: Session) -> None:
    """The configuration that lost it is not tried again, as in the Python client."""
    messages, devices = session(react="if (message.run === 2 && message.frame === 10) tools.lose();")

    runs = runs_of(messages)
    assert [(r["configuration"], r["status"]) for r in runs] == [
        ("default", "ok"), ("best", "failed"), ("best", "failed"), ("default", "ok"),
    ]  # fmt: skip
    assert all("the device was lost" in failed["failure"] for failed in runs[1:3])
    assert messages[-1] == {"type": "done", "interrupted": False}
    assert devices == 2
    warming = [m for m in of(messages, "progress") if m["phase"] == "checking" and m["run"] == 4]
    assert [m["frame"] for m in warming] == [0, 2]


@pytest.mark.slow
def test_a_device_that_is_lost_twice_in_a_row_ends_the_session(session: Session) -> None:
    messages, _ = session(react="if (message.run > 0 && message.frame === 0) tools.lose();")

    assert [r["status"] for r in runs_of(messages)] == ["failed", "failed"]
    assert messages[-1]["type"] == "failed"
    assert messages[-1]["code"] == "device_lost"


def test_a_device_that_is_lost_in_the_check_fails_its_configuration(session: Session) -> None:
    messages, devices = session(
        change="order.protocol.order = ['default'];",
        react="if (message.phase === 'checking') tools.lose();",
    )

    assert [r["status"] for r in runs_of(messages)] == ["failed", "failed"]
    assert messages[-1] == {"type": "done", "interrupted": False}
    assert devices == 1


@pytest.mark.slow
def test_a_shader_that_computes_something_else_is_found_before_anything_is_timed(session: Session) -> None:
    messages, _ = session(
        change="""const { shaders } = order.configurations[0];
        shaders.solve = shaders.solve.replace("fn solve(", "fn unused(");
        shaders.solve += "@compute @workgroup_size(64) fn solve() { state.pose[3] += 0.01; }";"""
    )

    assert messages[-1]["code"] == "wrong_results"
    assert re.match(r"default: the trajectory is \d\.\d+ m from its reference, the band is 0.005 m",
                    messages[-1]["detail"])  # fmt: skip
    assert not of(messages, "session")
    assert not of(messages, "run")


@pytest.mark.parametrize(
    ("given", "code", "detail"),
    [
        (
            {
                "change": """const { plan, shaders } = order.configurations[0];
                shaders.solve += "fn {";
                plan.dispatches = plan.dispatches.filter(({ kernel }) => kernel === "solve");"""
            },
            "error",
            r"refused the kernel solve: line \d+: ",
        ),
        (
            {"change": "order.chunks[0] = order.chunks[0].slice(0, 1000);"},
            "error",
            "frame 0 of a chunk of 1000 bytes is damaged",
        ),
        ({"gpu": "({ requestAdapter: async () => null })"}, "device_lost", ""),
        (
            {
                "change": "order.done = [{}]; order.session = { stage_clock: 'device', empty_frame_us: 1 };",
                "gpu": WITHOUT_TIMESTAMPS,
            },
            "cannot_resume",
            "",
        ),
    ],
    ids=["a shader does not compile", "the sequence is damaged", "no adapter", "other clocks than before"],
)
def test_what_cannot_be_measured_ends_the_session_with_its_reason(
    session: Session, given: dict[str, str], code: str, detail: str
) -> None:
    messages, _ = session(**given)

    assert (messages[-1]["type"], messages[-1]["code"]) == ("failed", code)
    assert re.search(detail, str(messages[-1].get("detail")))
    assert of(messages, "session") == of(messages, "run") == []


def test_compatibility_mode_serves_where_there_is_nothing_else(session: Session) -> None:
    gpu = """({ requestAdapter: async (options) => options.featureLevel === "compatibility"
        && options.powerPreference === "high-performance" ? navigator.gpu.requestAdapter() : null })"""

    messages, _ = session(gpu=gpu, react="if (message.phase === 'preparing') tools.stop();")

    assert [m["type"] for m in messages] == ["progress", "done"]


@pytest.fixture
def wasm_order(web_server: Any, order: dict[str, Any], pack: Path) -> None:
    """The order for WebAssembly, served."""
    publish(web_server, pack, order)
    configurations = [
        orders.configuration(each["name"], parameters, pack, each["band"], each["trajectory"], "wasm")
        for each, parameters in zip(order["configurations"], (DEFAULT, BEST), strict=True)
    ]
    changed = {"backend": "wasm", "module": orders.serve_module(web_server), "configurations": configurations}
    web_server.documents["/order-wasm"] = orders.encoded(order | changed)


@pytest.mark.slow
@pytest.mark.parametrize("browser", ["web_page", "firefox_page"])
def test_webassembly_measures_where_there_is_no_adapter(
    request: pytest.FixtureRequest, browser: str, wasm_order: None
) -> None:
    page = request.getfixturevalue(browser)

    messages = page.evaluate(WORK, {"url": "/order-wasm", "stopIn": 0})

    assert messages[-1] == {"type": "done", "interrupted": False}
    [clock] = of(messages, "session")
    claimed = page.evaluate("() => navigator.hardwareConcurrency")
    assert (clock["backend"], clock["stage_clock"]) == ("wasm", "wall")
    assert (clock["threads"] in (1, 2, 4), clock["threads_claimed"]) == (True, claimed)
    for result in runs_of(messages):
        assert (result["status"], result["failure"]) == ("ok", None)
        assert result["deviation"] < 0.005
        assert list(result["stages_us"]) == STAGES
        sums = np.sum(list(result["stages_us"].values()), axis=0)
        assert (sums <= result["frame_us"]).all()
    assert {(m["width"], m["height"], m["pixels"]) for m in of(messages, "picture")} == {(80, 60, 19200)}


# The device's threads take so many milliseconds a frame, and those of `broken` cannot be started.
PACE = """
    const { WasmExecution } = await import("/measure/wasm.js");
    const { create } = WasmExecution;
    const { run } = WasmExecution.prototype;
    const tried = [];
    WasmExecution.create = async (processor, plan) => {
        if (processor.threads === given.broken) throw new Error("a thread could not be started");
        if (plan.dispatches.length) tried.push(processor.threads);
        return create(processor, plan);
    };
    WasmExecution.prototype.run = async function (...frame) {
        return { ...await run.apply(this, frame), seconds: given.paces[this.threads] / 1000 };
    };
"""
CHOOSE = """self.onmessage = async ({ data: given }) => {
    FETCH_ORDER
    PACE
    const { measure } = await import("/measure/measurement.js");
    const order = { ...await fetchOrder("/order-wasm"), session: given.session };
    const stopping = new AbortController();
    let clock = null;
    await measure(order, {
        gpu: undefined,
        send: (message) => {
            if (message.type !== "session") return;
            clock = message;
            stopping.abort();
        },
        stored: async () => undefined,
        signal: stopping.signal,
    });
    self.postMessage({ clock, tried });
}""".replace("FETCH_ORDER", orders.FETCH_ORDER).replace("PACE", PACE)
# Threads wait for each other, which a page's own thread may not.
IN_A_WORKER = """(given) => new Promise((resolve, reject) => {
    const worker = new Worker("/measure/choosing.js", { type: "module" });
    worker.onerror = (error) => reject(new Error(error.message));
    worker.onmessage = ({ data }) => resolve(data);
    worker.postMessage(given);
})"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("paces", "broken", "chosen"),
    [
        ({1: 8.0, 2: 5.0, 4: 3.0}, 0, 4),
        ({1: 11.0, 2: 20.0, 4: 40.0}, 0, 1),
        ({1: 8.0, 2: 5.0, 4: 12.0}, 0, 2),
        ({1: 8.0, 2: 5.0, 4: 3.0}, 4, 2),
    ],
    ids=["four", "one on a busy machine", "two", "four cannot be started"],
)
def test_as_many_threads_compute_as_were_measured_to_be_fastest(
    web_page: Any,
    web_server: Any,
    wasm_order: dict[str, Any],
    paces: dict[int, float],
    broken: int,
    chosen: int,
) -> None:
    given = {"paces": {str(threads): pace for threads, pace in paces.items()}, "broken": broken}

    web_server.documents["/measure/choosing.js"] = CHOOSE.encode()

    found = web_page.evaluate(IN_A_WORKER, given | {"session": None})

    assert found["clock"]["threads"] == chosen
    assert found["clock"]["threads_claimed"] == web_page.evaluate("() => navigator.hardwareConcurrency")
    trials = [threads for threads in (1, 2, 4, 4, 2, 1) if threads != broken]
    assert found["tried"][: len(trials)] == trials
    assert set(found["tried"][len(trials) :]) == {chosen}
    # A resumed session computes by the threads that it began with.
    begun = {"backend": "wasm", "threads": 2, "stage_clock": "wall", "empty_frame_us": 9.0}
    resumed = web_page.evaluate(IN_A_WORKER, given | {"broken": 0, "session": begun})
    assert (resumed["clock"]["threads"], set(resumed["tried"])) == (2, {2})
