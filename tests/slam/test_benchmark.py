import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import slam
from slam.benchmark import run
from slam.configuration import ConfigurationError
from slam.datasets import SequenceError, open_sequence
from slam.datasets.formats import pack, tum
from slam.definitions import complete
from slam.devices.device import NoDeviceError
from slam.devices.opencl import BoundKernel
from slam.kfusion.configuration import STANDARD
from slam.reports.report import summary
from slam.system import STAGES
from tests.shipped import LIVING_ROOM
from tests.slam.sequences import ArraySequence
from tests.slam.tiny import write_tiny_pack

LEFT_OPEN = {"open_loop": True, "surfel_capacity": 50_000}
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
        judged = {"tracked", "integrated", "degenerate", "refusal", "outside", "skipped", "error"}
        assert set(frame) == times | judged
        assert 0 < sum(frame[stage] for stage in STAGES) <= frame["computation"]
        assert frame["total"] >= frame["acquisition"] + frame["computation"]
    assert max(frame["error"] for frame in data["frames"]) == pytest.approx(data["ate"]["max"])
    assert data["cpu_seconds"] > 0
    assert 0 < data["cpu_us"] < 1e6 * data["cpu_seconds"] + 1e5  # four counted frames of 14
    assert (data["energy_joules"] is None) == (data["energy_source"] is None)
    assert data["peak_memory_bytes"] is None or data["peak_memory_bytes"] > 10 * 2**20


def test_the_runtime_is_the_mean_from_frame_ten_on_and_the_largest_times_stand_beside_it(report):
    counted = [frame.computation for frame in report.frames[10:]]
    data = report.to_dict()
    assert data["runtime"] == report.runtime == pytest.approx(np.mean(counted))
    assert data["runtime_p95"] == pytest.approx(np.percentile(counted, 95))
    assert data["runtime_max"] == max(counted)


def test_a_skipped_frame_is_neither_tracked_nor_lost_and_costs_nothing():
    adaptive = {"skip_limit": 5, "skip_translation": 1.0, "skip_rotation": 1.0, "integration_rate": 1}
    report = run(QUICK | adaptive, open_sequence(LIVING_ROOM), frames=14)
    skipped = [frame for frame in report.frames if frame.skipped]
    assert skipped
    for frame in skipped:
        assert (frame.tracked, frame.integrated) == (None, False)
        assert sum(frame.stages.values()) == 0
    assert [frame["skipped"] for frame in report.to_dict()["frames"]].count(True) == len(skipped)


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


@pytest.mark.slow
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
        assert 0 < sum(frame.stages.values()) <= frame.computation


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


@pytest.fixture
def coloured(tmp_path):
    """A tiny folder in TUM's layout, with colour."""
    tum.write(open_sequence(write_tiny_pack(tmp_path, colour=True)), tmp_path / "tum")
    return tmp_path / "tum"


def without_colour(folder, *frames):
    lines = (folder / "rgb.txt").read_text().splitlines(keepends=True)
    (folder / "rgb.txt").write_text("".join(line for i, line in enumerate(lines) if i not in frames))
    return open_sequence(folder)


@pytest.mark.slow
@pytest.mark.parametrize("missing", [0, 3])
def test_a_frame_without_a_colour_image_is_named(coloured, missing):
    sequence = without_colour(coloured, missing)
    stamp = f"{sequence.timestamps[missing]:.6f} s"
    with pytest.raises(SequenceError, match=f"^frame {missing} of 'tum', at {stamp}, has no colour image"):
        run(LEFT_OPEN, sequence, system="elasticfusion")
    if missing:
        assert len(run(LEFT_OPEN, sequence, system="elasticfusion", frames=missing).frames) == missing


def test_colour_is_missing_where_no_frame_has_any(tmp_path):
    with pytest.raises(SequenceError, match="'tiny' has no colour, which elasticfusion needs"):
        run(LEFT_OPEN, open_sequence(write_tiny_pack(tmp_path)), system="elasticfusion")


@pytest.mark.slow
def test_loops_that_are_left_open_need_no_scipy(tmp_path, monkeypatch):
    sequence = open_sequence(write_tiny_pack(tmp_path, colour=True))
    for name in ("scipy", "scipy.sparse", "scipy.sparse.linalg"):
        monkeypatch.setitem(sys.modules, name, None)
    assert run(LEFT_OPEN, sequence, system="elasticfusion", frames=2).frames[1].tracked
    with pytest.raises(ConfigurationError, match="closing loops needs scipy"):
        run(LEFT_OPEN | {"open_loop": False}, sequence, system="elasticfusion", frames=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "configurations"),
    [
        ("kfusion", [QUICK | {"skip_limit": 1, "integration_rate": 1}, QUICK | {"raycast_after_fusion": 1}]),
        ("elasticfusion", [{"surfel_capacity": 50_000}]),
    ],
)
def test_every_kernel_has_run_before_the_first_frame(tmp_path, monkeypatch, system, configurations):
    launched, launch = [], BoundKernel.__call__

    def noted(kernel, *size):
        launched.append(kernel._kernel.function_name)
        return launch(kernel, *size)

    def stop(_):
        raise SequenceError("the first frame")

    sequence = open_sequence(write_tiny_pack(tmp_path, colour=True))
    monkeypatch.setattr(BoundKernel, "__call__", noted)
    monkeypatch.setattr(sequence, "depth", stop)
    for values in configurations:
        with pytest.raises(SequenceError, match="the first frame"):
            run(complete(system, values), sequence, system=system)
    kernels = {
        name
        for source in (Path(slam.__file__).parent / system / "kernels").glob("*.cl")
        for name in re.findall(r"^kernel void (\w+)", source.read_text(), re.MULTILINE)
    }
    assert len(kernels) > 5
    assert kernels <= set(launched)


@pytest.mark.slow
def test_the_standard_configuration_is_valid_on_the_first_brisk_frames():
    report = run(STANDARD.to_dict(), open_sequence(LIVING_ROOM), frames=30)
    assert report.valid
    assert sum(frame.tracked is True for frame in report.frames) == 26


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "size"), [(8, (136, 88)), (1, (141, 91))])
def test_images_of_any_size_are_run_and_the_report_says_what_was_cropped(ratio, size):
    living_room = open_sequence(LIVING_ROOM)
    depth = [living_room.depth(frame)[100:191, 100:241] for frame in range(6)]
    odd = ArraySequence(depth, truth=living_room.truth[:6], volume_size=5.0)
    found = run({**QUICK, "compute_size_ratio": ratio}, odd)
    assert (found.sequence["width"], found.sequence["height"]) == size
    assert found.sequence.get("cropped_from") == ([141, 91] if ratio > 1 else None)
    cropped = f"{size[0]}x{size[1]} (cropped from 141x91)" in summary(found.to_dict())
    assert cropped == (ratio > 1)


def test_images_of_a_pack_are_not_cropped(tmp_path):
    written = pack.write(ArraySequence(np.full((1, 91, 141), 1500)), tmp_path / "odd")
    with pytest.raises(ConfigurationError, match="ratio 8 must be a positive divisor of 141x91"):
        run({**QUICK, "compute_size_ratio": 8}, written)


def test_a_report_says_when_the_camera_sees_beyond_the_volume(report):
    """The room is 4.8 m wide; a volume of 1.5 m holds little of what the camera sees."""
    assert max(frame.outside for frame in report.frames) < 0.1
    assert "outside" not in summary(report.to_dict())

    small = run(
        QUICK, open_sequence(LIVING_ROOM), frames=6, volume_size=1.5, initial_position=(0.5, 0.5, 0.1)
    )

    assert min(frame.outside for frame in small.frames) > 0.5
    assert "in 6 of 6 frames (first 0, last 5) more than half" in summary(small.to_dict())
