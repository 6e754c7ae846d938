"""The newest shipped front on a real recording that no search ever saw."""

from __future__ import annotations

import json

import pytest

from crowd.fronts.content.generalisation import bound
from slam.benchmark import run
from slam.datasets import open_sequence
from slam.devices.choice import choose_device
from slam.registry import open_session
from tests.benchmarks.sequences import REAL_STARTS, WINDOW, Excerpt, newest_fronts
from tests.slam.real import DATA, needs_real_data


@pytest.fixture(scope="module")
def recording():
    return open_sequence(DATA / "rgbd" / "redkitchen")


@pytest.fixture(scope="module")
def session():
    return open_session("kfusion", choose_device())


@pytest.mark.slow
@needs_real_data
@pytest.mark.parametrize("frames", [WINDOW // 2, pytest.param(WINDOW, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("start", REAL_STARTS)
def test_best_holds_on_a_real_recording(recording, session, start, frames):
    front = json.loads(newest_fronts()[-1].read_text())
    points = {point["name"]: point["parameters"] for point in front["configurations"]}
    sequence = Excerpt(recording, start, frames)

    default, best = (run(points[name], sequence, device=session) for name in ("default", "best"))

    assert not [frame for frame in best.frames if frame.tracked is False]
    assert best.ate.max <= bound(default.ate.max)
