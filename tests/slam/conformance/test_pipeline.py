"""KinectFusion on every backend: the same trajectory, and the same volume, as on the first OpenCL device."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from slam.datasets import open_sequence
from slam.devices.choice import AnySession, choose_device, open_session
from slam.kfusion.configuration import STANDARD
from slam.kfusion.pipeline import KFusion
from slam.protocol import NO_STAGES
from slam.system import STAGES, Scene
from tests.shipped import LIVING_ROOM

FRAMES = 8


def scene() -> Scene:
    sequence = open_sequence(LIVING_ROOM)
    return Scene(sequence.camera, sequence.volume_size, sequence.initial_position)


@functools.cache
def images() -> list[np.ndarray]:
    sequence = open_sequence(LIVING_ROOM)
    return [sequence.depth(index) for index in range(FRAMES)]


def run(session: AnySession) -> tuple[KFusion, list]:
    system = KFusion(STANDARD, scene(), session)
    return system, [system.process(image) for image in images()]


@functools.cache
def expected() -> tuple[KFusion, list]:
    return run(open_session(choose_device()))


@pytest.mark.slow
def test_eight_frames_give_the_trajectory_of_opencl_within_half_a_millimetre(session):
    system, frames = run(session)
    other, others = expected()
    assert [frame.tracked for frame in frames] == [frame.tracked for frame in others]
    assert [frame.integrated for frame in frames] == [frame.integrated for frame in others]
    apart = np.linalg.norm(
        [f.pose[:3, 3] - o.pose[:3, 3] for f, o in zip(frames, others, strict=True)], axis=1
    )
    assert apart.max() < 0.0005
    middle = system.volume.resolution // 2
    distances, weights = system.volume.read(middle, middle + 1)
    expected_distances, expected_weights = other.volume.read(middle, middle + 1)
    assert (abs(distances - expected_distances) > 0.05).mean() < 0.01
    assert (weights != expected_weights).mean() < 0.01


@pytest.mark.slow
def test_the_stages_are_all_measured_or_none_is(session):
    system, frames = run(session)
    measured = set() if system.stage_clock == NO_STAGES else set(STAGES)
    assert all(set(frame.seconds) == measured for frame in frames)
    assert all(frame.computation > 0 for frame in frames)


@pytest.mark.slow
def test_a_volume_is_empty_before_the_first_frame(session):
    distances, weights = KFusion(STANDARD, scene(), session).volume.read(0, 3)
    assert (distances == 1).all()
    assert not weights.any()


@pytest.mark.slow
def test_the_view_is_what_the_last_raycast_saw(session):
    system, _ = run(session)
    other, _ = expected()
    view, expected_view = system.view(), other.view()
    found, expected_found = view.normals.any(axis=-1), expected_view.normals.any(axis=-1)
    assert (found != expected_found).mean() < 0.01
    both = found & expected_found
    assert np.median(np.linalg.norm(view.vertices - expected_view.vertices, axis=-1)[both]) < 5e-4
