"""The objectives of a configuration by name. All are minimised."""

from collections.abc import Mapping
from typing import Any

from wire.protocol import RUNTIMES

RATIO, ERROR_RATIO = "runtime_ratio", "ate_max_ratio"
# Frames that a configuration loses and the default does not, on the worst sequence. Not minimised: a
# configuration that loses the camera is fast because it does not track, so the search counts it as failed.
LOST_MORE = "lost_more"
BESIDE_DEFAULT = (RATIO, ERROR_RATIO, LOST_MORE)
# In SI units: seconds a frame, metres, bytes.
MEASURED = (
    *RUNTIMES,
    RATIO,
    "ate_max",
    ERROR_RATIO,
    "ate_mean",
    "ate_rmse",
    "ate_rmse_aligned",
    "cpu_seconds",
    "peak_memory_bytes",
)


def without_ratios(objectives: Mapping[str, Any]) -> dict[str, Any]:
    """`objectives` as a machine reports them. Only the server knows the default's, and so the ratios."""
    return {name: value for name, value in objectives.items() if name not in BESIDE_DEFAULT}
