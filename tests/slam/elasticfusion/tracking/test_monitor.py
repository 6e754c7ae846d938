"""When a camera counts as lost, and when as found."""

from __future__ import annotations

from slam.elasticfusion.configuration import LOST_AFTER
from slam.elasticfusion.tracking.monitor import TrackingMonitor


def after(failures: int, relocalisation: bool = True) -> TrackingMonitor:
    monitor = TrackingMonitor(relocalisation)
    for _ in range(failures):
        monitor.record(good=False)
    return monitor


def test_a_camera_is_lost_after_one_failure_too_many_in_a_row():
    assert not after(LOST_AFTER).lost
    assert after(LOST_AFTER + 1).lost
    interrupted = after(LOST_AFTER)
    interrupted.record(good=True)
    interrupted.record(good=False)
    assert not interrupted.lost


def test_a_bad_frame_is_not_fused_and_a_lost_camera_fuses_nothing():
    assert after(0).fuses(good=True)
    assert not after(1).fuses(good=False)
    assert not after(LOST_AFTER + 1).fuses(good=True)


def test_without_relocalisation_nothing_is_noticed_and_all_is_fused():
    monitor = after(100, relocalisation=False)
    assert not monitor.lost
    assert monitor.fuses(good=False)


def test_a_recognised_camera_is_found_once_it_is_tracked_there():
    monitor = after(LOST_AFTER + 1)
    monitor.record(good=True)
    assert monitor.lost  # tracked from frame to frame, but nowhere in the map
    monitor.recognised()
    assert (monitor.lost, monitor.on_probation) == (True, True)
    monitor.record(good=True)
    assert (monitor.lost, monitor.on_probation) == (False, False)
    monitor.record(good=False)
    assert not monitor.lost


def test_a_camera_that_fails_its_probation_stays_lost():
    monitor = after(LOST_AFTER + 1)
    monitor.recognised()
    monitor.record(good=False)
    assert (monitor.lost, monitor.on_probation) == (True, False)
