"""The numbers of the paper: Nardi et al. 2017, Algorithmic Performance-Accuracy Trade-off in 3D Vision
Applications Using HyperMapper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# KinectFusion, by device.
RANDOM = {"ODROID-XU3": 3000, "ASUS T200TA": 3000}
ACTIVE = {"ODROID-XU3": 1142, "ASUS T200TA": 1392}
VALID_RANDOM = {"ODROID-XU3": 333, "ASUS T200TA": 291}
VALID_ACTIVE = {"ODROID-XU3": 642, "ASUS T200TA": 665}
FRONT = {"ODROID-XU3": 36, "ASUS T200TA": 167}
ITERATIONS = 6  # of active learning on the ODROID-XU3
RANDOM_USEFUL = 2000  # samples after which random sampling no longer improved the front
REFIT_SECONDS = 120.0  # an iteration fits the forests and predicts the whole space in less
DEFAULT_FPS, DEFAULT_ERROR = 6.0, 0.0447  # on the ODROID-XU3; the error in metres
BEST_SPEED = 6.35  # times the default, on the ODROID-XU3
DEVICES, LEAST_SPEEDUP, MOST_SPEEDUP = 83, 2.0, 12.0  # of the crowd

ELASTICFUSION_RANDOM, ELASTICFUSION_ACTIVE = 2400, 999


@dataclass(frozen=True)
class Row:
    """A row of the table of ElasticFusion: metres, seconds of the whole run, and the configuration."""

    label: str
    error: float
    runtime: float
    configuration: dict[str, Any]


def _row(label: str, error: float, runtime: float, *values: Any) -> Row:
    names = ("icp_weight", "depth_cutoff", "confidence_threshold", "disable_so3", "fast_odometry")
    return Row(label, error, runtime, dict(zip(names, values, strict=True)))


# On a GTX 780 Ti. The paper's SO3 is 1 where it is on. Flags that it leaves at their defaults are left out.
ELASTICFUSION = (
    _row("default", 0.0558, 22.2, 10, 3.0, 10, False, False),
    _row("best speed", 0.0420, 14.6, 5, 6.0, 9, True, True),
    _row("between", 0.0332, 15.2, 4, 6.0, 9, True, True),
    _row("between", 0.0302, 15.8, 2, 10.0, 4, True, True),
    _row("best accuracy", 0.0269, 17.2, 1, 10.0, 4, True, True),
)
# Those of its rows that are measured here, too.
ELASTICFUSION_KNOWN = {
    f"the paper's {row.label}": row.configuration for row in (ELASTICFUSION[1], ELASTICFUSION[-1])
}
