"""What a plan says without a device is the same in JavaScript and in Python."""

from __future__ import annotations

import dataclasses
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
from slam.plans.plan import Plan
from slam.plans.webgpu import _packed
from tests.slam.kfusion.test_plan import SCENE

GOLDEN_FILE = Path(__file__).resolve().parents[2] / "slam" / "kfusion" / "plans" / "pixels.json"
FRAMES = 30
GOLDEN = Plan.from_dict(json.loads(GOLDEN_FILE.read_text(encoding="utf-8")))
PLANS = {
    "golden": GOLDEN,
    "standard": plan(STANDARD, SCENE, LAYOUT),
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
        frames: [{}, { refusal: 2 }, { recovering: 1 }].map((before) =>
            numbers.map((number) => plan.dispatches.map((d) => p.takesPlace(d, number, before)))
        ),
        tracks: numbers.map((number) => p.tracks(plan, number)),
    };
}"""


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_a_plan_is_read_as_python_reads_it(web_page: Any, name: str) -> None:
    made = PLANS[name]
    state = made.initial_state()
    tracking = next(dispatch for dispatch in made.dispatches if dispatch.kernel == "track")

    described = web_page.evaluate(DESCRIBE, {"plan": made.to_dict(), "frames": FRAMES})

    assert bytes(described["state"]) == state.tobytes()
    assert described["members"] == [[m.name, np.ravel(state[m.name]).tolist()] for m in made.state]
    assert described["stages"] == list(made.stages)
    assert described["segments"] == [[s.stage, [d.kernel for d in s.dispatches]] for s in segments(made)]
    assert described["buffers"] == [b.planes * b.nbytes(state.itemsize) for b in made.buffers]
    assert described["groups"] == [list(dispatch.groups) for dispatch in made.dispatches]
    assert described["uniforms"] == [[list(pair) for pair in uniforms(kernel)] for kernel in made.kernels]
    assert [bytes(part) for part in described["packed"]] == [
        _packed(made.kernel(dispatch.kernel), dispatch) for dispatch in made.dispatches
    ]
    refused, recovering = made.initial_state(), made.initial_state()
    refused["refusal"], recovering["recovering"] = 2, 1
    assert described["frames"] == [
        [[d.takes_place(number, before) for d in made.dispatches] for number in range(FRAMES)]
        for before in (state, refused, recovering)
    ]
    assert described["tracks"] == [tracking.takes_place(number) for number in range(FRAMES)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"version": 2}, "a plan of version 2: this program reads version 1"),
        ({"layout": "rows"}, "laid out by rows, where pixels are executed"),
    ],
)  # fmt: skip
def test_a_plan_that_cannot_be_executed_is_refused(
    web_page: Any, change: dict[str, Any], reason: str
) -> None:
    altered = dataclasses.replace(GOLDEN, **change).to_dict()

    with pytest.raises(Exception, match=reason):
        web_page.evaluate(DESCRIBE, {"plan": altered, "frames": 1})
