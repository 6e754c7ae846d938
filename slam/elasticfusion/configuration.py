"""The algorithmic parameters of ElasticFusion, its further thresholds, and its constants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from slam.configuration import ConfigurationError, Parameters, finite, flag, whole

# Constants of the published system; lengths in metres, angles in radians unless said otherwise.
NEAREST = 0.3  # nearer measurements are discarded
FARTHEST = 20.0  # surfels are predicted and tracked against up to here
REFERENCE_PIXELS = 640 * 480  # thresholds on numbers of pixels are for this size
LEVELS = 3
ITERATIONS = (10, 5, 4)  # of the registration, finest level first
MIN_VELOCITY_WEIGHT = 0.5  # what a frame of a fast camera counts
FULL_WEIGHT_BELOW = 0.01  # metres or radians a frame: linear from weight 1 at rest to the least weight here
LARGEST_RGB_STEP = 0.3  # metres a frame; a larger step is refused if colour contributed to it
LOST_ICP_ERROR = 1e-4  # of the registration to the model, at REFERENCE_PIXELS
LOST_DEVIATION = 0.005  # of the registered pose: metres, and radians
LOST_AFTER = 10  # failures in a row; one more and the camera is lost
LOOP_ICP_WEIGHT = 10.0  # of the registration of active to inactive model, whatever tracking has
ICP_ONLY = 100.0  # icp_weight from which colour has no part


@dataclass(frozen=True)
class Configuration(Parameters):
    """One point of the design space, and settings outside it; the defaults are the paper's.

    icp_weight: weight of the point-to-plane error beside the photometric one; 0 is colour alone, 100 or more
    depth alone. depth_cutoff: metres beyond which depth is not used. confidence_threshold: confidence from
    which a surfel is stable. disable_so3: no alignment of colour images by rotation before the registration.
    open_loop: no loops are closed, and the whole map is active. relocalisation: whether a lost camera is
    noticed and found again. fast_odometry: colour is registered at the finest level only.
    frame_to_frame_rgb: colour is registered to the previous frame instead of the model.

    time_window: frames for which a surfel stays active. compute_size_ratio: depth and colour are sampled at
    every n-th pixel, unaveraged, as KinectFusion does it. icp_count_threshold, icp_error_threshold: a local
    loop must be registered with more inliers and a smaller error (both at 640x480). icp_deviation_threshold:
    the largest standard deviation of its pose with which it is closed, in metres of position and radians of
    rotation. photometric_threshold: mean L1 distance of colours (three channels of 0 to 255) below which a
    fern's view is recognised. fern_threshold: dissimilarity above which a view is a new keyframe.
    fern_agreement: share of equal ferns above which a keyframe is registered to the view;
    fern_error_threshold: error of that registration (at 640x480; the published 3e-4 is for 80x60) and
    fern_inliers, fern_inliers_lost: share of the pixels measured in both with which it is accepted, the
    latter by a lost camera; fern_deviation_threshold: its largest standard deviation, likewise.
    closure_distance: least gap of a global loop before, closure_error: largest gap after (metres), and
    closure_energy: largest energy of its deformation. surfel_capacity: surfels the map can hold. seed: of the
    random ferns.
    """

    system: ClassVar[str] = "ElasticFusion"

    icp_weight: float = 10.0
    depth_cutoff: float = 3.0
    confidence_threshold: int = 10
    disable_so3: bool = False
    open_loop: bool = False
    relocalisation: bool = True
    fast_odometry: bool = False
    frame_to_frame_rgb: bool = False
    time_window: int = 200
    compute_size_ratio: int = 1
    icp_count_threshold: int = 35_000
    icp_error_threshold: float = 5e-5
    icp_deviation_threshold: float = 0.01
    photometric_threshold: float = 115.0
    fern_threshold: float = 0.3095
    fern_agreement: float = 0.3
    fern_error_threshold: float = 3.75e-5
    fern_deviation_threshold: float = 0.003
    fern_inliers: float = 0.5
    fern_inliers_lost: float = 0.29
    closure_distance: float = 0.06
    closure_error: float = 3e-4
    closure_energy: float = 0.12
    surfel_capacity: int = 3_000_000
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in _WHOLE.items():
            object.__setattr__(self, name, whole(name, getattr(self, name), least))
        for name in _FLAGS:
            object.__setattr__(self, name, flag(name, getattr(self, name)))
        for name in _POSITIVE:
            value = finite(name, getattr(self, name))
            if value <= 0:
                raise ConfigurationError(f"{name}={value!r}: must be above 0")
            object.__setattr__(self, name, value)
        weight, cutoff = finite("icp_weight", self.icp_weight), finite("depth_cutoff", self.depth_cutoff)
        if weight < 0:
            raise ConfigurationError(f"icp_weight={weight!r}: must be 0 (colour alone) or more")
        if not NEAREST < cutoff <= FARTHEST:
            raise ConfigurationError(
                f"depth_cutoff={cutoff!r}: must be above {NEAREST} and at most {FARTHEST:g} (metres)"
            )
        object.__setattr__(self, "icp_weight", weight)
        object.__setattr__(self, "depth_cutoff", cutoff)


_WHOLE = {
    "confidence_threshold": 1,
    "time_window": 1,
    "compute_size_ratio": 1,
    "icp_count_threshold": 0,
    "surfel_capacity": 1,
    "seed": 0,
}
_FLAGS = ("disable_so3", "open_loop", "relocalisation", "fast_odometry", "frame_to_frame_rgb")
_POSITIVE = (
    "icp_error_threshold",
    "icp_deviation_threshold",
    "photometric_threshold",
    "fern_threshold",
    "fern_agreement",
    "fern_error_threshold",
    "fern_deviation_threshold",
    "fern_inliers",
    "fern_inliers_lost",
    "closure_distance",
    "closure_error",
    "closure_energy",
)

DEFAULT = Configuration()
