"""What a plan says without a device is the same in JavaScript and in Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slam.devices.webgpu import LAYOUT
from slam.kfusion.configuration import STANDARD
from slam.kfusion.plan import plan
from slam.plans.declarations import uniforms
from slam.plans.execution import segments
from slam.plans.plan import Plan, State
from slam.plans.webgpu import _packed
from tests.slam.kfusion.test_plan import ADAPTIVE, SCENE

GOLDEN_FILE = Path(__file__).resolve().parents[2] / "slam" / "kfusion" / "plans" / "pixels.json"
FRAMES = 30
GOLDEN = Plan.from_dict(json.loads(GOLDEN_FILE.read_text(encoding="utf-8")))
PLANS = {
    "golden": GOLDEN,
    "standard": plan(STANDARD, SCENE, LAYOUT),
    "adaptive": plan(ADAPTIVE, SCENE, LAYOUT),
}
DESCRIBE = """async ({ plan, frames }) => {
    const p = await import("/measure/plan.js");
    p.checkPlan(plan, "pixels");
    const numbers = Array.from({ length: frames }, (_, number) => number);
    const bytes = (data) => Array.from(new Uint8Array(data));
    const initial = p.initialState(plan);
    return {
        state: bytes(initial),
        members: Object.entries(p.readState(plan, initial)).map(
            ([name, value]) => [name, typeof value === "number" ? [value] : Array.from(value)]
        ),
        stages: p.stagesOf(plan),
        segments: p.segmentsOf(plan).map((s) => [s.stage, s.dispatches.map((d) => d.kernel)]),
        buffers: plan.buffers.map((buffer) => p.bufferBytes(plan, buffer)),
        groups: plan.dispatches.map(p.groupsOf),
        uniforms: plan.kernels.map((kernel) => p.uniformsOf(kernel).map((u) => [u.name, u.type])),
        packed: plan.dispatches.map((d) => bytes(p.packedUniforms(p.kernelOf(plan, d.kernel), d).buffer)),
        frames: [p.readState(plan, initial), { refusal: 2 }, { recovering: 1 }, { fusing: 1 }].map((before) =>
            numbers.map((number) => plan.dispatches.map((d) => p.takesPlace(d, number, before)))
        ),
        tracks: numbers.map((number) => p.tracks(plan, number)),
    };
}"""
SERVE = """async ({ plan, state, frames }) => {
    const p = await import("/measure/plan.js");
    const before = p.readState(plan, Uint8Array.from(state).buffer);
    return Array.from({ length: frames }, (_, number) => {
        const served = p.servedState(plan, before, number);
        return served && Object.entries(served).map(
            ([name, value]) => [name, typeof value === "number" ? [value] : Array.from(value)]
        );
    });
}"""


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_a_plan_is_read_as_python_reads_it(web_page: Any, name: str) -> None:
    made = PLANS[name]
    state = made.initial_state()
    tracking = next(dispatch for dispatch in made.dispatches if dispatch.kernel == "track")

    described = web_page.evaluate(DESCRIBE, {"plan": made.to_dict(), "frames": FRAMES})

    assert bytes(described["state"]) == state.tobytes()
    assert described["members"] == members(made, state)
    assert described["stages"] == list(made.stages)
    assert described["segments"] == [[s.stage, [d.kernel for d in s.dispatches]] for s in segments(made)]
    assert described["buffers"] == [b.planes * b.nbytes(state.itemsize) for b in made.buffers]
    assert described["groups"] == [list(dispatch.groups) for dispatch in made.dispatches]
    assert described["uniforms"] == [[list(pair) for pair in uniforms(kernel)] for kernel in made.kernels]
    assert [bytes(part) for part in described["packed"]] == [
        _packed(made.kernel(dispatch.kernel), dispatch) for dispatch in made.dispatches
    ]
    befores = [state]
    for name_of_flag, value in {"refusal": 2, "recovering": 1, "fusing": 1}.items():
        befores.append(np.zeros((), state.dtype))
        if name_of_flag in state.dtype.names:
            befores[-1][name_of_flag] = value
    assert described["frames"] == [
        [[d.takes_place(number, before) for d in made.dispatches] for number in range(FRAMES)]
        for before in befores
    ]
    assert described["tracks"] == [tracking.takes_place(number) for number in range(FRAMES)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"version": 3}, "a plan of version 3: this program reads 1 and 2"),
        ({"layout": "rows"}, "laid out by rows, where pixels are executed"),
    ],
)
def test_a_plan_that_cannot_be_executed_is_refused(
    web_page: Any, change: dict[str, Any], reason: str
) -> None:
    altered = GOLDEN.to_dict() | change

    with pytest.raises(Exception, match=reason):
        web_page.evaluate(DESCRIBE, {"plan": altered, "frames": 1})


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_a_skipped_frame_is_served_as_python_serves_it(web_page: Any, name: str) -> None:
    made = PLANS[name]
    state = made.initial_state()
    if made.skipping:
        state[made.skipping.count] = 2
        state[made.skipping.poses] = np.arange(len(state[made.skipping.poses]))

    served = web_page.evaluate(SERVE, {"plan": made.to_dict(), "state": list(state.tobytes()), "frames": 3})

    assert served == [members(made, made.served(state, number)) for number in range(3)]
    assert (served[0] is None) == (made.skipping is None)


def members(made: Plan, state: State | None) -> list[list[Any]] | None:
    """The members of a state as JavaScript describes them."""
    return None if state is None else [[m.name, np.ravel(state[m.name]).tolist()] for m in made.state]
