"""What of a front's protocol the pages speak of."""

from collections.abc import Mapping
from typing import Any

from slam.protocol import FIRST_COUNTED_FRAME, VALID_BELOW


def first_counted_frame(protocol: Mapping[str, Any]) -> int:
    """The first frame (from 0) that the statistics count."""
    return int(protocol.get("first_counted_frame", FIRST_COUNTED_FRAME))


def max_ate(protocol: Mapping[str, Any]) -> float:
    """The trajectory error in metres from which on a run is invalid."""
    return float(protocol.get("max_ate", VALID_BELOW))
