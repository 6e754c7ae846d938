import json

import numpy as np
import pytest

from slam.benchmark import run
from slam.configuration import ConfigurationError
from slam.datasets import SequenceError, open_sequence
from slam.kfusion.configuration import STANDARD
from slam.opencl import NoDeviceError
from slam.system import STAGES
from tests.slam.sequences import ArraySequence
from tests.slam.shipped import LIVING_ROOM

QUICK = {
    "compute_size_ratio": 4,
    "volume_resolution": 128,
    "pyramid_iterations_fine": 4,
    "pyramid_iterations_middle": 3,
    "pyramid_iterations_coarse": 2,
}


@pytest.fixture(scope="module")
def report():
    return run(QUICK, open_sequence(LIVING_ROOM), frames=14)


def test_a_report_is_the_json_that_others_read(report):
    data = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert {"system", "configuration", "sequence", "device", "frames", "runtime"} <= set(data)
    assert {"ate", "valid", "cpu_seconds", "peak_memory_bytes"} <= set(data)
    assert data["system"] == "kfusion"
    assert data["configuration"].items() >= QUICK.items()
    assert len(data["configuration"]) == 9
    assert set(data["sequence"]) == {"name", "frames", "width", "height", "sha256"}
    assert data["sequence"]["sha256"] == open_sequence(LIVING_ROOM).sha256
    assert set(data["device"]) == {"platform", "name", "driver", "backend"}
    assert set(data["ate"]) == {"mean", "max", "rmse", "rmse_aligned"}
    assert len(data["frames"]) == 14
    for frame in data["frames"]:
        times = {"acquisition", *STAGES, "rendering", "computation", "total"}
        assert set(frame) == times | {"tracked", "integrated", "error"}
        assert frame["computation"] == pytest.approx(sum(frame[stage] for stage in STAGES))
        assert frame["total"] >= frame["acquisition"] + frame["computation"]
    assert max(frame["error"] for frame in data["frames"]) == pytest.approx(data["ate"]["max"])
    assert data["cpu_seconds"] > 0
    assert (data["energy_joules"] is None) == (data["energy_source"] is None)
    assert data["peak_memory_bytes"] is None or data["peak_memory_bytes"] > 10 * 2**20


def test_the_runtime_is_the_mean_from_frame_ten_on(report):
    counted = [frame.computation for frame in report.frames[10:]]
    assert report.runtime == pytest.approx(np.mean(counted))


def test_frames_without_a_model_are_not_attempted_and_the_rest_is_tracked(report):
    assert [frame.tracked for frame in report.frames] == [None] * 4 + [True] * 10


def test_the_estimate_follows_the_truth(report):
    assert report.valid
    assert report.ate.max < 0.02
    assert report.trajectory().poses.shape == (14, 4, 4)


def test_frames_that_tracking_skips_are_neither_tracked_nor_lost():
    report = run(QUICK | {"tracking_rate": 3}, open_sequence(LIVING_ROOM), frames=8)
    tracked = [frame.tracked for frame in report.frames]
    assert tracked[6] is not None
    assert [tracked[i] for i in (0, 1, 2, 3, 4, 5, 7)] == [None] * 7


def test_a_configuration_that_loses_track_is_not_valid():
    sequence = open_sequence(LIVING_ROOM)
    # Only every 30th depth image: jumps of 30 cm that no registration from the last pose bridges.
    jumps = ArraySequence([sequence.depth(i) for i in (0, 0, 0, 0, 30, 60, 90)])
    jumps.camera = sequence.camera
    jumps.truth = sequence.truth[[0, 0, 0, 0, 30, 60, 90]]
    report = run(QUICK, jumps, volume_size=4.8, initial_position=(0.5, 0.48, 0.1))
    assert report.valid is False
    assert np.isfinite(report.poses).all()


def test_without_truth_the_error_is_unknown_and_not_zero():
    sequence = open_sequence(LIVING_ROOM)
    sequence.truth = None
    report = run(QUICK, sequence, frames=1)
    assert report.ate is None
    assert report.valid is None
    assert report.runtime == report.frames[0].computation


def test_progress_counts_every_frame():
    seen = []
    run(QUICK, open_sequence(LIVING_ROOM), frames=3, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_an_observer_sees_every_frame_and_its_time_is_no_computation():
    seen = []

    def observe(index, system):
        seen.append((index, system.view() is not None))

    report = run(QUICK, open_sequence(LIVING_ROOM), frames=5, observe=observe)
    assert seen == [(0, False), (1, False), (2, False), (3, True), (4, True)]
    for frame in report.frames:
        assert frame.rendering > 0
        assert frame.computation == pytest.approx(sum(frame.stages.values()))


@pytest.mark.parametrize(
    ("configuration", "options", "error", "message"),
    [
        ({}, {"frames": 0}, SequenceError, "frames=0: give 1 to 100"),
        ({}, {"frames": 101}, SequenceError, "frames=101"),
        ({"mu": -1}, {}, ConfigurationError, "mu"),
        ({"compute_size_ratio": 3}, {}, ConfigurationError, "640x480"),
        ({}, {"volume_size": 0}, ConfigurationError, "volume_size"),
        ({}, {"device": "no such device"}, NoDeviceError, "no such device"),
        ({}, {"system": "orbslam"}, ValueError, "unknown system 'orbslam'"),
    ],
)
def test_what_cannot_be_run_says_why(configuration, options, error, message):
    with pytest.raises(error, match=message):
        run(configuration, open_sequence(LIVING_ROOM), **options)


def test_the_standard_configuration_is_valid_on_the_first_brisk_frames():
    report = run(STANDARD.to_dict(), open_sequence(LIVING_ROOM), frames=30)
    assert report.valid
    assert sum(frame.tracked is True for frame in report.frames) == 26
