"""KinectFusion on every backend: the same trajectory, and the same volume, as on the first OpenCL device."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pytest

from slam.datasets import open_sequence
from slam.devices.choice import AnySession, choose_device, open_session
from slam.kfusion.configuration import STANDARD
from slam.kfusion.pipeline import KFusion
from slam.system import STAGES, Frame, Scene
from tests.shipped import LIVING_ROOM
from wire.protocol import NO_STAGES

FRAMES = 8


def scene() -> Scene:
    sequence = open_sequence(LIVING_ROOM)
    return Scene(sequence.camera, sequence.volume_size, sequence.initial_position)


@functools.cache
def images() -> list[np.ndarray]:
    sequence = open_sequence(LIVING_ROOM)
    return [sequence.depth(index) for index in range(FRAMES)]


@dataclass(frozen=True)
class Run:
    """What a system gave for each frame, its first voxels before that, and the system afterwards."""

    empty: tuple[np.ndarray, np.ndarray]
    frames: list[Frame]
    system: KFusion


def run(session: AnySession) -> Run:
    system = KFusion(STANDARD, scene(), session)
    return Run(system.volume.read(0, 3), [system.process(image) for image in images()], system)


@functools.cache
def expected() -> Run:
    return run(open_session(choose_device()))


@pytest.fixture(scope="module")
def found(session: AnySession) -> Run:
    return run(session)


@pytest.mark.slow
def test_eight_frames_give_the_trajectory_of_opencl_within_half_a_millimetre(found):
    frames, others = found.frames, expected().frames
    assert [frame.tracked for frame in frames] == [frame.tracked for frame in others]
    assert [frame.integrated for frame in frames] == [frame.integrated for frame in others]
    apart = np.linalg.norm(
        [f.pose[:3, 3] - o.pose[:3, 3] for f, o in zip(frames, others, strict=True)], axis=1
    )
    assert apart.max() < 0.0005
    middle = found.system.volume.resolution // 2
    distances, weights = found.system.volume.read(middle, middle + 1)
    expected_distances, expected_weights = expected().system.volume.read(middle, middle + 1)
    assert (abs(distances - expected_distances) > 0.05).mean() < 0.01
    assert (weights != expected_weights).mean() < 0.01


@pytest.mark.slow
def test_the_stages_are_all_measured_or_none_is(found):
    measured = set() if found.system.stage_clock == NO_STAGES else set(STAGES)
    assert all(set(frame.seconds) == measured for frame in found.frames)
    assert all(frame.computation > 0 for frame in found.frames)


@pytest.mark.slow
def test_a_volume_is_empty_before_the_first_frame(found):
    distances, weights = found.empty
    assert (distances == 1).all()
    assert not weights.any()


@pytest.mark.slow
def test_the_view_is_what_the_last_raycast_saw(found):
    view, expected_view = found.system.view(), expected().system.view()
    hit, expected_hit = view.normals.any(axis=-1), expected_view.normals.any(axis=-1)
    assert (hit != expected_hit).mean() < 0.01
    both = hit & expected_hit
    assert np.median(np.linalg.norm(view.vertices - expected_view.vertices, axis=-1)[both]) < 5e-4
