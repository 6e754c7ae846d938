"""Whether the camera knows where it is."""

from __future__ import annotations

from slam.elasticfusion.configuration import LOST_AFTER


class Health:
    """Counts failures of tracking, for a system that is to notice them (`relocalisation`).

    More than LOST_AFTER failures in a row and the camera is `lost`, until it is recognised somewhere. It is
    then `on_probation` for one frame, which shows whether it really is there.
    """

    def __init__(self, relocalisation: bool) -> None:
        self._watches = relocalisation
        self._failures = 0
        self.lost = False
        self.on_probation = False

    def judge(self, good: bool) -> None:
        """Take note of how a frame was tracked."""
        if not self._watches:
            return
        if self.on_probation:
            self.lost = not good
            self.on_probation = False
        if not self.lost:
            self._failures = 0 if good else self._failures + 1
            self.lost = self._failures > LOST_AFTER

    def recognised(self) -> None:
        """A lost camera saw something that it knows."""
        self.on_probation = True

    def fuses(self, good: bool) -> bool:
        """Whether a frame that was tracked like that may become part of the map."""
        return not self.lost and (good or not self._watches)
