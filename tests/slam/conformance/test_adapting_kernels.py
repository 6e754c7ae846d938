"""The kernels that adapt to the motion give what their NumPy references give, wherever kernels run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from slam.kfusion.configuration import MOST_SKIPPED
from tests.slam.conformance.values import ADAPTIVE, pose_at, state_of
from tests.slam.numpy_kernels import adapting as reference
from tests.slam.numpy_kernels.kfusion import rotation_between

LIMITS = reference.Limits(
    skip_limit=3, skip_translation=0.05, skip_rotation=0.03, integrate_translation=0.05,
    integrate_rotation=0.04, kept_inliers=0.85, decay=0.98, cautious=8, early=4,
)  # fmt: skip
PLACE, TWIST = np.array([1.0, 1.2, 0.8]), np.array([0.3, -0.2, 0.1])
POSE = pose_at(PLACE, TWIST)
# Of a camera that stands still and of which all is known.
STILL = {
    "pose": POSE, "previous": POSE, "start": POSE, "fused": POSE,
    "ahead": np.tile(POSE, (MOST_SKIPPED + 1, 1, 1)), "velocity": np.zeros(3),
    "turn": np.zeros(3), "last_turn": np.zeros(3),
    "tracked": 1, "recovering": 0, "misses": 0, "last_inliers": 0.8, "most_inliers": 0.8,
    "skip": 0, "left_out": 0, "elapsed": 1, "caution": 0, "fusing": 0, "adapted": 4,
}  # fmt: skip


def away(x: float, turn: float = 0.0) -> np.ndarray:
    """POSE moved by `x` metres and turned by `turn` radians."""
    return reference.moved(POSE, np.array([0, x, 0]), np.array([0, 0, turn]))


AHEAD = np.array([away(0.01 * number, 0.02 * number) for number in range(1, MOST_SKIPPED + 2)])


def steady(members: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The speeds of a camera that moved before as it does now."""
    frames = members["elapsed"]
    turn = rotation_between(members["previous"], POSE) / frames
    return {"velocity": (POSE - members["previous"])[:3, 3] / frames, "last_turn": turn}


def launched(launch, session, name: str, before: Mapping[str, Any], **limits: float) -> np.ndarray:
    """The state after a kernel."""
    values = {
        member: value[..., :3, :].ravel() if np.ndim(value) > 1 else value for member, value in before.items()
    }
    state = state_of(before["pose"], ADAPTIVE, **{k: v for k, v in values.items() if k != "pose"})
    launch(name, session.layout.one_group(1), state=state, **limits)
    return state


def assert_members(state: np.ndarray, expected: Mapping[str, Any]) -> None:
    for name, value in expected.items():
        wanted = value[..., :3, :].ravel() if np.ndim(value) > 1 else value
        np.testing.assert_allclose(state[name], wanted, atol=2e-6, err_msg=name)


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        ({}, POSE),
        ({"skip": 2}, AHEAD[2]),
        ({"skip": 5}, AHEAD[5]),
        # Recovering: begin_tracking has turned the camera by each check that failed, and by this one.
        ({"recovering": 3, "elapsed": 0}, POSE),
        ({"recovering": 3, "elapsed": 4, "misses": 1}, away(0, 0.06)),
        ({"recovering": 2, "elapsed": 5, "misses": 2}, away(0, 0.06)),
        ({"recovering": 1, "elapsed": 6, "misses": 3}, POSE),
    ],
    ids=lambda members: ",".join(members) if isinstance(members, dict) else "",
)
def test_predict(launch, session, before, expected):
    """ICP starts where the motion leads; while the camera recovers, its turn goes on."""
    before = STILL | {"ahead": AHEAD, "turn": np.array([0, 0, 0.02]), "elapsed": 0} | before

    state = launched(launch, session, "predict", before, most_extrapolated=3)

    assert_members(state, reference.predict(before, 3))
    skip, elapsed = before["skip"], before["elapsed"]
    assert (state["left_out"], state["skip"], state["elapsed"]) == (skip, 0, elapsed + skip + 1)
    np.testing.assert_allclose(state["start"], expected[:3].ravel(), atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({}, {"skip": 3, "fusing": 0, "caution": 0}),
        # 11 mm a frame, up to four frames until the one after next: less than 50 mm.
        ({"previous": away(-0.011)}, {"skip": 2, "fusing": 0}),
        ({"previous": away(-0.044), "elapsed": 4}, {"skip": 2}),
        ({"previous": away(-0.02)}, {"skip": 0}),
        ({"previous": away(0, -0.007)}, {"skip": 2}),
        ({"previous": away(0, -0.012)}, {"skip": 0}),
        # It began to move, or stopped: it may move faster still.
        ({"previous": away(-0.005), "velocity": np.zeros(3)}, {"skip": 1}),
        ({"previous": away(-0.02), "elapsed": 4, "velocity": np.zeros(3)}, {"skip": 3}),
        ({"velocity": np.array([0, 0.01, 0])}, {"skip": 1}),
        ({"velocity": np.array([0, 0.02, 0])}, {"skip": 0}),
        ({"previous": away(0, -0.003), "last_turn": np.zeros(3)}, {"skip": 1}),
        ({"last_turn": np.array([0, 0, 0.02])}, {"skip": 0}),
        ({"last_inliers": 0.7}, {"skip": 3}),
        ({"last_inliers": 0.6}, {"skip": 0}),
        ({"last_inliers": 0.6, "most_inliers": 0.7}, {"skip": 3}),
        ({"last_inliers": 0.9}, {"skip": 3, "most_inliers": 0.9}),
        # Beside where it was expected.
        ({"left_out": 2, "start": away(0.04)}, {"skip": 3, "caution": 0}),
        ({"left_out": 2, "start": away(0.06)}, {"skip": 0, "caution": 8}),
        ({"left_out": 2, "start": away(0, 0.04)}, {"skip": 0, "caution": 8}),
        ({"left_out": 0, "start": away(0.06)}, {"skip": 3, "caution": 0}),
        ({"left_out": 2, "start": away(0.06), "caution": 3}, {"skip": 0, "caution": 8}),
        ({"caution": 3}, {"skip": 0, "caution": 2}),
        ({"caution": 1}, {"skip": 3, "caution": 0}),
        ({"recovering": 5}, {"skip": 0, "fusing": 1}),
        ({"recovering": 5, "left_out": 2, "start": away(0.06)}, {"skip": 0, "caution": 8, "fusing": 1}),
        ({"tracked": 0, "left_out": 2, "elapsed": 3}, {"skip": 0, "fusing": 1, "elapsed": 3}),
        # Expected farther on than now.
        ({"fused": away(-0.03), "previous": away(-0.011)}, {"skip": 2, "fusing": 1}),
        ({"fused": away(-0.01), "previous": away(-0.011)}, {"skip": 2, "fusing": 0}),
        ({"fused": away(-0.06), "fusing": 1}, {"fusing": 0}),
        ({"fused": away(0, 0.05)}, {"fusing": 1}),
        ({"fused": away(-0.03), "previous": away(-0.015)}, {"skip": 1, "fusing": 1}),
        ({"adapted": 0}, {"fusing": 1, "adapted": 1}),
        ({"adapted": 3}, {"fusing": 1, "adapted": 4}),
    ],
    ids=lambda members: ",".join(members),
)  # fmt: skip
def test_adapt(launch, session, changed, found):
    before = STILL | steady(STILL | changed) | changed

    state = launched(launch, session, "adapt", before, **asdict(LIMITS))

    expected = reference.adapt(before, LIMITS)
    assert_members(state, expected)
    assert {name: expected[name] for name in found} == found


@pytest.mark.parametrize("limit", [0, 1, MOST_SKIPPED])
def test_adapt_skips_no_more_than_the_limit(launch, session, limit):
    limits = {**asdict(LIMITS), "skip_limit": limit}
    state = launched(launch, session, "adapt", STILL, **limits)

    assert state["skip"] == limit
    assert_members(state, reference.adapt(STILL, reference.Limits(**limits)))
