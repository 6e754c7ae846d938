"""The plan of a frame: golden files, the schema, and what layouts may and may not change."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.camera import Camera
from slam.configuration import ConfigurationError
from slam.devices.layout import KINDS, Layout
from slam.kfusion.configuration import Configuration
from slam.kfusion.plan import plan
from slam.plans.execution import segments
from slam.plans.plan import SCHEMA, STATE, Frames, Plan
from slam.system import Scene

GOLDEN = Path(__file__).parent / "plans"
SCENE = Scene(Camera(120.0, 120.0, 79.5, 59.5, 160, 120), volume_size=3.2, initial_position=(0.5, 0.5, 0.1))
CAMERA = Camera(480.0, 480.0, 319.5, 239.5, 640, 480)
SMALL = Configuration(
    compute_size_ratio=2, volume_resolution=64, integration_rate=3, tracking_rate=2, mu=0.2,
    pyramid_iterations_fine=2, pyramid_iterations_middle=1, pyramid_iterations_coarse=0,
)  # fmt: skip
ADAPTIVE = dataclasses.replace(
    SMALL, tracking_rate=1, integration_rate=1, skip_limit=3, skip_translation=0.05, skip_rotation=0.03,
    integrate_translation=0.06, integrate_rotation=0.04,
)  # fmt: skip
GOLDEN_PLANS = {"": SMALL, "adaptive-": ADAPTIVE}
THRESHOLDS = st.sampled_from([0.0, 0.05])
RATES = st.fixed_dictionaries({"integration_rate": st.integers(1, 30), "tracking_rate": st.integers(1, 9)})
ADAPTING = st.fixed_dictionaries(
    {"integration_rate": st.just(1), "tracking_rate": st.just(1), "skip_limit": st.integers(0, 5),
     "skip_translation": THRESHOLDS, "skip_rotation": THRESHOLDS,
     "integrate_translation": THRESHOLDS, "integrate_rotation": THRESHOLDS}
)  # fmt: skip
CONFIGURATIONS = st.builds(
    lambda rates, **others: Configuration(**rates, **others),
    rates=RATES | ADAPTING,
    compute_size_ratio=st.sampled_from([1, 2, 4]),
    raycast_after_fusion=st.integers(0, 1),
    icp_threshold=st.floats(0, 60),
    mu=st.floats(1e-9, 1),
    volume_resolution=st.sampled_from([8, 60, 64, 128]),
    pyramid_iterations_fine=st.integers(1, 10),
    pyramid_iterations_middle=st.integers(0, 10),
    pyramid_iterations_coarse=st.integers(0, 10),
)


@pytest.mark.parametrize("prefix", GOLDEN_PLANS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_plan_is_the_golden_one(kind, prefix):
    """To change it on purpose, write `to_json()` over the file."""
    golden = (GOLDEN / f"{prefix}{kind}.json").read_text(encoding="utf-8")
    assert plan(GOLDEN_PLANS[prefix], SCENE, Layout(kind)).to_json() == golden


@pytest.mark.slow
@settings(max_examples=20)
@given(CONFIGURATIONS, st.sampled_from(KINDS))
def test_a_plan_follows_the_schema_and_comes_back_from_its_json(configuration, kind):
    text = plan(configuration, SCENE, Layout(kind)).to_json()
    document = json.loads(text)

    jsonschema.validate(document, json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert Plan.from_dict(document).to_json() == text


@settings(max_examples=20)
@given(CONFIGURATIONS, st.sampled_from(KINDS))
def test_every_argument_is_what_its_kernel_takes(configuration, kind):
    made = plan(configuration, SCENE, Layout(kind))
    for dispatch in made.dispatches:
        for parameter in made.kernel(dispatch.kernel).parameters:
            value = dispatch.arguments[parameter.name]
            if parameter.access:
                buffer = made.buffer(value)
                assert (buffer.type, buffer.planes) == (parameter.type, parameter.planes)
            elif parameter.type == "vec4f":
                assert len(value) == 4
            else:
                assert isinstance(value, int | float)
        assert set(dispatch.arguments) == {p.name for p in made.kernel(dispatch.kernel).parameters}
        assert all(size % group == 0 for size, group in zip(dispatch.size, dispatch.group, strict=True))


@settings(max_examples=20)
@given(CONFIGURATIONS)
def test_layouts_share_order_conditions_and_values(configuration):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("slam.kfusion.plan.SMALL_IMAGE", 0)
        rows, pixels = (plan(configuration, SCENE, Layout(kind)) for kind in KINDS)

    def what(dispatch):
        scalars = {k: v for k, v in dispatch.arguments.items() if not isinstance(v, str) and k != "count"}
        return dispatch.kernel, dispatch.stage, dispatch.frames, dispatch.flag, scalars

    assert list(map(what, rows.dispatches)) == list(map(what, pixels.dispatches))
    assert rows.state == pixels.state
    assert rows.constants.items() <= pixels.constants.items()


def test_by_rows_one_launch_makes_all_iterations_of_a_small_image():
    coarse = dataclasses.replace(SMALL, pyramid_iterations_coarse=3)
    made = plan(coarse, dataclasses.replace(SCENE, camera=CAMERA), Layout("rows"))
    launches = [
        (d.kernel, d.arguments["width"], d.arguments.get("iterations"))
        for d in made.dispatches
        if "min_dot" in d.arguments and d.takes_place(4)
    ]

    assert launches == [("iterate", 80, 3), ("track", 160, None), ("track", 320, None), ("track", 320, None)]


def test_by_pixels_a_kernel_has_eight_storage_buffers_and_groups_of_128_at_most():
    made = plan(SMALL, SCENE, Layout("pixels"))
    for kernel in made.kernels:
        assert sum(parameter.access is not None for parameter in kernel.parameters) <= 8
    for dispatch in made.dispatches:
        assert dispatch.group[0] * (dispatch.group[1] if len(dispatch.group) > 1 else 1) <= 128
    assert all(buffer.fill == 0 for buffer in made.buffers)


def test_rays_after_fusion_are_cast_in_the_frames_that_may_be_fused_and_the_view_is_kept_with_them():
    kept = dataclasses.replace(SMALL, integration_rate=5, raycast_after_fusion=1)
    made = plan(kept, SCENE, Layout("rows"))
    lost = made.initial_state()
    lost["recovering"] = 3

    for kernel in ("raycast", "keep_view"):
        [launched] = [d for d in made.dispatches if d.kernel == kernel]
        assert [number for number in range(20) if launched.takes_place(number)] == [3, 5, 10, 15]
        assert launched.takes_place(7, lost)
    names = [d.kernel for d in made.dispatches]
    assert "begin_at_view" in names
    assert "begin_tracking" not in names


def test_frames_are_multiples_of_every_and_not_counted_from_the_first():
    frames = Frames(first=4, last=11, every=3)

    assert [number for number in range(20) if frames.hold(number)] == [6, 9]


def test_frames_after_a_member_of_the_state_need_it_to_have_been_set():
    frames = Frames(first=4, every=2, after="refusal")
    state = plan(SMALL, SCENE, Layout("rows")).initial_state()

    assert not any(frames.hold(number, state) or frames.hold(number) for number in range(20))
    state["refusal"] = 2
    assert [number for number in range(10) if frames.hold(number, state)] == [4, 6, 8]


def test_rates_decide_in_which_frames_a_stage_runs():
    made = plan(SMALL, SCENE, Layout("pixels"))
    frames = {
        stage: [n for n in range(10) if any(d.stage == stage and d.takes_place(n) for d in made.dispatches)]
        for stage in made.stages
    }

    assert frames == {
        "preprocessing": list(range(10)),
        "tracking": [4, 6, 8],
        "integration": [0, 1, 2, 3, 6, 9],
        "raycasting": [3, 4, 5, 6, 7, 8, 9],
    }


def test_a_stage_is_one_segment_unless_its_conditions_differ():
    assert [segment.stage for segment in segments(plan(SMALL, SCENE, Layout("rows")))] == [
        "preprocessing", "tracking", "tracking", "integration", "integration", "raycasting",
    ]  # fmt: skip


def test_a_ray_makes_progress_however_small_mu_is():
    """The step was three quarters of mu alone: with 1e-9 a ray never came to its end."""
    made = plan(dataclasses.replace(SMALL, mu=1e-9), SCENE, Layout("rows"))
    [raycast] = [dispatch for dispatch in made.dispatches if dispatch.kernel == "raycast"]

    assert raycast.arguments["large_step"] == pytest.approx(3.2 / 64 / 16)


def test_the_state_has_no_padding():
    made = plan(SMALL, SCENE, Layout("rows"))

    assert made.state_type.itemsize == sum(4 * member.count for member in made.state)
    assert made.buffer("state").type == STATE


def test_a_volume_without_size_is_refused():
    with pytest.raises(ConfigurationError, match=r"volume_size=0: must be above 0"):
        plan(SMALL, dataclasses.replace(SCENE, volume_size=0), Layout("rows"))


@pytest.mark.parametrize(
    ("changed", "version", "adapts"),
    [
        ({}, 2, True),
        ({"skip_limit": 0}, 1, True),
        ({"skip_limit": 0, "integrate_translation": 0, "integrate_rotation": 0}, 1, False),
    ],
    ids=str,
)
def test_only_a_plan_that_skips_frames_is_of_version_2(changed, version, adapts):
    made = plan(dataclasses.replace(ADAPTIVE, **changed), SCENE, Layout("rows"))
    document = made.to_dict()

    assert document["version"] == version
    assert ("skipping" in document) == (version == 2)
    assert Plan.from_dict(document).to_dict() == document
    assert {"predict", "adapt"} <= {each.kernel for each in made.dispatches} or not adapts
    assert ("ahead" in {member.name for member in made.state}) == adapts


def test_a_plan_of_another_version_is_refused():
    document = plan(ADAPTIVE, SCENE, Layout("rows")).to_dict() | {"version": 3}

    with pytest.raises(ValueError, match="a plan of version 3: this program reads 1 and 2"):
        Plan.from_dict(document)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, json.loads(SCHEMA.read_text(encoding="utf-8")))


def test_kernels_keep_their_numbers_in_a_plan_that_adapts():
    """The module of WebAssembly numbers them."""
    fixed, adaptive = (plan(each, SCENE, Layout("rows")) for each in (SMALL, ADAPTIVE))

    assert adaptive.kernels[: len(fixed.kernels)] == fixed.kernels
    assert adaptive.state[: len(fixed.state)] == fixed.state


def test_a_skipped_frame_is_served_from_the_state_before():
    made = plan(ADAPTIVE, SCENE, Layout("rows"))
    state = made.initial_state()
    assert made.served(state, 0) is None
    state["skip"], state["ahead"] = 2, np.arange(len(state["ahead"]))

    served = [made.served(state, number) for number in range(3)]

    assert [None if each is None else each["pose"].tolist() for each in served] == [
        list(range(12)), list(range(12, 24)), None,
    ]  # fmt: skip
    assert state["pose"].tolist() == made.initial_state()["pose"].tolist()
    assert plan(SMALL, SCENE, Layout("rows")).served(state, 0) is None


def test_a_frame_that_is_fused_by_motion_is_a_tracked_one():
    made = plan(dataclasses.replace(ADAPTIVE, skip_limit=0, tracking_rate=2), SCENE, Layout("rows"))
    [before, *_] = integrations = [each for each in made.dispatches if each.kernel == "integrate"]
    state = made.initial_state()

    def fused() -> list[int]:
        return [number for number in range(4, 10) if any(d.takes_place(number, state) for d in integrations)]

    assert before.takes_place(3, state)
    assert fused() == [4, 6, 8]
    state["fusing"] = 0
    assert fused() == []
