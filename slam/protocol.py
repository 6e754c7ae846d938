"""The protocol of a measurement: which frames count, and which trajectories are valid."""

from collections.abc import Mapping
from typing import Any

FIRST_COUNTED_FRAME = 10  # the first frames fill the model and the caches
VALID_BELOW = 0.05  # metres of maximal trajectory error
# A run that has lost the camera in more of its frames than this has failed, however fast it was.
MOST_LOST = 0.5
LEAST_MATCHED = 0.8  # share of a run's frames that need a true pose for its trajectory to count
MAX_DRIFT = 1.15  # later repeats over earlier ones: a session that slows down more is set aside
DECODED_AHEAD = 100  # frames that are decoded before they are measured: 61 MB of depth at 640x480
# Version 1 of the protocol repeats until the interval is narrow. Version 2 fixes the number of pairs and
# compares each run with a reference trajectory.
ADAPTIVE, FIXED_PAIRS = 1, 2
VERSION = FIXED_PAIRS  # that clients measure by
PAIRS = 4  # of default and best in a session of version 2
PROBE_PAIRS = 2  # of the default and each configuration that a device is asked for besides
LEAST_PAIRS = 3  # for an interval in version 2: two pairs give a uselessly wide one
ONLY_ADAPTIVE = ("max_repeats", "precision", "max_seconds")  # members of a protocol of version 1
NO_STAGES = "none"  # the `stage_clock` where nothing measured the stages


def fixed_pairs(protocol: Mapping[str, Any]) -> dict[str, Any]:
    """A front's PROTOCOL converted to version 2."""
    kept = {name: value for name, value in protocol.items() if name not in ONLY_ADAPTIVE}
    return (
        kept if protocol.get("version") == FIXED_PAIRS else kept | {"version": FIXED_PAIRS, "repeats": PAIRS}
    )
