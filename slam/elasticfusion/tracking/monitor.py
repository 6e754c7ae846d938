"""Watches for lost tracking."""

from __future__ import annotations

from slam.elasticfusion.configuration import LOST_AFTER


class TrackingMonitor:
    """Counts failures of tracking, for a system with `relocalisation`.

    After more than LOST_AFTER failures in a row the camera is `lost`, until a keyframe is recognised. It is
    then `on_probation` for one frame, which confirms or rejects the new pose.
    """

    def __init__(self, relocalisation: bool) -> None:
        self._watches = relocalisation
        self._failures = 0
        self.lost = False
        self.on_probation = False

    def record(self, good: bool) -> None:
        """Record whether a frame was tracked."""
        if not self._watches:
            return
        if self.on_probation:
            self.lost = not good
            self.on_probation = False
        if not self.lost:
            self._failures = 0 if good else self._failures + 1
            self.lost = self._failures > LOST_AFTER

    def recognised(self) -> None:
        """Record that a lost camera recognised a keyframe."""
        self.on_probation = True

    def fuses(self, good: bool) -> bool:
        """Whether a frame with this result may be fused into the map."""
        return not self.lost and (good or not self._watches)
