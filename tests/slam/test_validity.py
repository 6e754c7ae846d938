import numpy as np
import pytest

from slam.benchmark import run
from slam.datasets import open_sequence
from slam.isolated import MeasurementError, read_report
from slam.reports.report import summary
from slam.validity import Verdict, judge
from tests.shipped import LIVING_ROOM
from tests.slam.sequences import ArraySequence

QUICK = {"compute_size_ratio": 8, "volume_resolution": 64}
HELD = [None] * 4 + [True] * 6


@pytest.mark.parametrize(
    ("tracked", "matched", "largest", "verdict"),
    [
        (HELD, 10, 0.049, Verdict(True, None)),
        (HELD, 8, 0.049, Verdict(True, None)),
        (HELD, 10, 0.05, Verdict(False, "the largest error is not below 0.05 m")),
        (HELD, 10, float("nan"), Verdict(False, "the largest error is not below 0.05 m")),
        (HELD, 0, None, Verdict(None, "no frame has a true pose")),
        (
            HELD, 7, 0.0,
            Verdict(None, "only 7 of 10 frames have a true pose, at least 80 % are needed"),
        ),
        ([True], 1, 0.0, Verdict(None, "only 1 of 1 frames have a true pose, at least 80 % are needed")),
        ([None] * 10, 10, 0.0, Verdict(False, "no frame was tracked")),
        ([None] * 4 + [False] * 6, 10, 0.0, Verdict(False, "tracking lost in 6 of 6 frames")),
        ([None] * 4 + [False] * 3 + [True] * 3, 10, 0.01, Verdict(True, None)),
    ],
)  # fmt: skip
def test_a_run_is_valid_when_it_was_tracked_compared_and_accurate(tracked, matched, largest, verdict):
    assert judge(tracked, matched, largest) == verdict


@pytest.fixture(scope="module")
def living_room():
    return open_sequence(LIVING_ROOM)


def still(depth, living_room, truth):
    sequence = ArraySequence(depth, truth=truth)
    sequence.camera = living_room.camera
    return sequence


def test_a_recording_without_any_depth_is_not_valid(living_room):
    still_poses = np.tile(np.eye(4), (8, 1, 1))
    report = run(QUICK, still(np.zeros((8, 480, 640)), living_room, still_poses)).to_dict()
    assert report["valid"] is False
    assert report["ate"]["max"] == 0
    assert ": valid" not in summary(report).split("mean ... max:")[0]


def test_one_matched_pose_of_eight_is_not_judged(living_room):
    truth = np.full((8, 4, 4), np.nan)
    truth[3] = np.eye(4)
    depth = np.stack([living_room.depth(index) for index in range(8)])
    report = run(QUICK, still(depth, living_room, truth)).to_dict()
    assert (report["matched_poses"], report["matched_share"]) == (1, 0.125)
    assert report["valid"] is None
    text = summary(report)
    assert "1 of 8 frames (12 %)" in text
    assert "not judged (only 1 of 8 frames have a true pose, at least 80 % are needed)" in text
    with pytest.raises(MeasurementError, match="only 1 of 8"):
        read_report(report)
