"""A report says when the camera was lost, why, for how long, and whether it came back."""

from __future__ import annotations

from slam.reports.losses import Loss, lines, losses

LOST = {"tracked": False, "refusal": "moved too far"}
TRACKED, SKIPPED = {"tracked": True, "refusal": None}, {"tracked": None, "refusal": None}


def test_a_loss_lasts_until_a_frame_is_tracked():
    frames = [TRACKED, LOST, SKIPPED, LOST, TRACKED, TRACKED, LOST]

    assert losses(frames) == [Loss(1, 2, 4, "moved too far"), Loss(6, 1, None, "moved too far")]
    assert lines(frames) == [
        "frame 1, for 2 frames, found again in frame 4: moved too far",
        "frame 6, for 1 frame, not found again: moved too far",
    ]


def test_nothing_is_said_of_a_camera_that_was_never_lost():
    assert lines([SKIPPED, TRACKED, TRACKED]) == []


def test_a_system_without_reasons_has_its_losses_listed():
    assert lines([{"tracked": False, "refusal": None}]) == ["frame 0, for 1 frame, not found again"]


def test_many_losses_are_counted():
    assert lines([LOST, TRACKED] * 7)[-2:] == [
        "frame 8, for 1 frame, found again in frame 9: moved too far",
        "and 2 more",
    ]
