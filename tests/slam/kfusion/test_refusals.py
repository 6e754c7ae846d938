"""Every refusal says its rule, its figure and the limit."""

from __future__ import annotations

import numpy as np
import pytest

from slam.kfusion.refusals import Refusal, reason
from tests.slam.conformance.test_tracking_kernels import LIMITS
from tests.slam.conformance.values import state_of


@pytest.mark.parametrize(
    ("refusal", "text"),
    [
        (0, None),
        (Refusal.INLIERS, "too few inliers: 25% of the pixels, 15% are needed"),
        (Refusal.RESIDUAL, "residual too large: 40.0 mm, 20 mm are allowed"),
        (Refusal.TRANSLATION, "moved too far: 0.45 m, 0.40 m are allowed"),
        (Refusal.ROTATION, "turned too far: 0.12 rad, 0.50 rad are allowed"),
        (
            Refusal.FAR_MOTION,
            "too few inliers for a motion of 0.45 m and 0.12 rad: 25% of the pixels, "
            "50% of those that see the model",
        ),
        (Refusal.OUTSIDE, "left the volume of 2.4 m"),
    ],
)
def test_a_refusal_has_its_figures(refusal, text):
    """The limits of a motion grow with the checks missed: here two."""
    state = state_of(
        np.eye(4), refusal=refusal, misses=2, inliers=250, overlap=500, squared_error=0.4, translation=0.45,
        rotation=0.12,
    )  # fmt: skip
    assert reason(state, vars(LIMITS)) == text


def test_a_frame_without_any_inlier_has_a_reason():
    state = state_of(np.eye(4), refusal=Refusal.INLIERS, misses=1, squared_error=np.nan)
    assert reason(state, vars(LIMITS)) == "too few inliers: 0% of the pixels, 15% are needed"
