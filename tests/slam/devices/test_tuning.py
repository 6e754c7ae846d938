"""The layout of the kernels is tried once per device and remembered."""

from __future__ import annotations

import dataclasses
import json

import pytest

from slam.devices.choice import choose_device, list_devices
from slam.devices.layout import Layout
from slam.devices.opencl import Session
from slam.devices.tuning import FIRST_JUDGED, FRAMES, SCENE, Trial, candidates, layout_for, wavy_wall
from slam.kfusion.pipeline import KFusion
from slam.registry import PROGRAMS, TRIED

TRIAL = PROGRAMS["kfusion"].trial


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.delenv("FRONTRUNNER_KERNELS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def instant(monkeypatch):
    """A trial takes no time: the test is about what becomes of its answer."""
    monkeypatch.setattr(Trial, "seconds", lambda *tried: 1.0 if tried[2].kind == "rows" else 2.0)


@pytest.mark.slow
def test_every_device_gets_one_of_its_candidates_and_keeps_it(cache):
    for device in list_devices():
        layout = layout_for(device, TRIAL)
        assert layout in candidates(device)
        assert layout_for(device, TRIAL) == layout
    (file,) = cache.rglob("layouts.json")
    assert len(json.loads(file.read_text())) == len(list_devices())


def test_what_is_remembered_is_not_tried_again(cache, instant):
    device = choose_device()
    layout_for(device, TRIAL)
    (file,) = cache.rglob("layouts.json")
    (key,) = json.loads(file.read_text())
    file.write_text(json.dumps({key: ["pixels", 8, 4]}))
    assert layout_for(device, TRIAL) == Layout("pixels", (8, 4))


@pytest.mark.parametrize("content", ["", "[]", '{"x": 1}', "{"])
def test_a_damaged_memory_is_made_again(cache, instant, content):
    layout_for(choose_device(), TRIAL)
    (file,) = cache.rglob("layouts.json")
    file.write_text(content)
    assert layout_for(choose_device(), TRIAL).kind in {"rows", "pixels"}
    assert json.loads(file.read_text())


def test_a_trial_reports_each_frame_of_each_layout(cache):
    done = []
    device = choose_device()
    layout_for(device, TRIAL, lambda *count: done.append(count))

    total = len(candidates(device)) * FRAMES
    assert sorted(set(done)) == done[:1] + [(frames, total) for frames in range(1, total + 1)]
    assert done == sorted(done)
    assert done.count((total, total)) == 1


def test_a_trial_judges_frames_that_track_and_raycast():
    """Before, it took the fastest frame: one of the first four, which do neither."""
    system = KFusion(TRIED, SCENE, Session(choose_device()))
    frames = [system.process(*wavy_wall(SCENE.camera, number)) for number in range(FRAMES)]

    assert all(frame.tracked for frame in frames[FIRST_JUDGED:])
    assert all(frame.seconds["raycasting"] > 0 for frame in frames[FIRST_JUDGED:])


def test_the_users_choice_comes_first(cache, monkeypatch):
    monkeypatch.setenv("FRONTRUNNER_KERNELS", "pixels")
    assert layout_for(choose_device(), TRIAL).kind == "pixels"
    monkeypatch.setenv("FRONTRUNNER_KERNELS", "voxels")
    with pytest.raises(ValueError, match="kernel layout 'voxels': choose one of rows, pixels"):
        layout_for(choose_device(), TRIAL)


def test_a_device_that_refuses_a_layout_is_not_given_it():
    device = choose_device()
    small = dataclasses.replace(device, max_allocation=2**20)
    assert TRIAL.seconds(small, Layout("rows"), print) == float("inf")
    assert TRIAL.seconds(device, Layout("rows"), print) < 60
