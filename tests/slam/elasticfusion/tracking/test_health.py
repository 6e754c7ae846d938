"""When a camera counts as lost, and when as found."""

from __future__ import annotations

from slam.elasticfusion.configuration import LOST_AFTER
from slam.elasticfusion.tracking.health import Health


def after(failures: int, relocalisation: bool = True) -> Health:
    health = Health(relocalisation)
    for _ in range(failures):
        health.judge(good=False)
    return health


def test_a_camera_is_lost_after_one_failure_too_many_in_a_row():
    assert not after(LOST_AFTER).lost
    assert after(LOST_AFTER + 1).lost
    interrupted = after(LOST_AFTER)
    interrupted.judge(good=True)
    interrupted.judge(good=False)
    assert not interrupted.lost


def test_a_bad_frame_is_not_fused_and_a_lost_camera_fuses_nothing():
    assert after(0).fuses(good=True)
    assert not after(1).fuses(good=False)
    assert not after(LOST_AFTER + 1).fuses(good=True)


def test_without_relocalisation_nothing_is_noticed_and_all_is_fused():
    health = after(100, relocalisation=False)
    assert not health.lost
    assert health.fuses(good=False)


def test_a_recognised_camera_is_found_once_it_is_tracked_there():
    health = after(LOST_AFTER + 1)
    health.judge(good=True)
    assert health.lost  # tracked from frame to frame, but nowhere in the map
    health.recognised()
    assert (health.lost, health.on_probation) == (True, True)
    health.judge(good=True)
    assert (health.lost, health.on_probation) == (False, False)
    health.judge(good=False)
    assert not health.lost


def test_a_camera_that_fails_its_probation_stays_lost():
    health = after(LOST_AFTER + 1)
    health.recognised()
    health.judge(good=False)
    assert (health.lost, health.on_probation) == (True, False)
