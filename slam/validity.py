"""Whether a run's trajectory was compared with the truth, and stayed close to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wire.protocol import LEAST_MATCHED, MOST_LOST, VALID_BELOW


@dataclass(frozen=True)
class Verdict:
    """`valid`: True, False, or None where there was too little truth. `reason`: why not True."""

    valid: bool | None
    reason: str | None


def tracking_failure(tracked: Sequence[bool | None]) -> str | None:
    """Why a run failed, or None.

    `tracked` holds True, False (lost) or None (not attempted) for each frame. A run fails if no frame was
    tracked, or more than MOST_LOST of the attempted frames were lost.
    """
    lost, attempted = tracked.count(False), len(tracked) - tracked.count(None)
    if lost > MOST_LOST * attempted:
        return f"tracking lost in {lost} of {attempted} frames"
    return None if attempted else "no frame was tracked"


def judge(tracked: Sequence[bool | None], matched: int, largest_error: float | None) -> Verdict:
    """Judge a run by its frames (as in `tracking_failure`) and by its trajectory.

    `matched`: how many frames have a true pose. `largest_error`: metres, None where none has. A run is valid
    if it has not failed, LEAST_MATCHED of its frames and at least two were compared, and its largest error
    lies below VALID_BELOW.
    """
    if largest_error is None or matched == 0:
        return Verdict(None, "no frame has a true pose")
    failure = tracking_failure(tracked)
    if failure is not None:
        return Verdict(False, failure)
    if matched < max(2, LEAST_MATCHED * len(tracked)):
        needed = f"at least {100 * LEAST_MATCHED:g} % are needed"
        return Verdict(None, f"only {matched} of {len(tracked)} frames have a true pose, {needed}")
    if not largest_error < VALID_BELOW:
        return Verdict(False, f"the largest error is not below {VALID_BELOW} m")
    return Verdict(True, None)
