"""The algorithmic parameters of KinectFusion, nine and six optional ones, and the constants that are not
parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from slam.configuration import ConfigurationError, Parameters, finite, whole

# Constants of SLAMBench's KinectFusion; lengths in metres.
BILATERAL_SPATIAL_SIGMA = 4.0  # pixels
BILATERAL_RANGE_SIGMA = 0.1
HALF_SAMPLE_RANGE = 0.3
ASSOCIATION_DISTANCE = 0.1
ASSOCIATION_NORMAL = 0.8  # dot product of unit normals
MAX_RESIDUAL = 0.02  # root mean square of the point-to-plane error
MIN_INLIERS = 0.15  # of the pixels of the level solved last
# Beyond this motion, metres plus radians, a pose rests on partners found on its way and needs more inliers.
NEAR_MOTION = ASSOCIATION_DISTANCE
FAR_INLIERS = 0.3
KEPT_INLIERS = 0.75  # of the share at the last check that passed, where no check was missed since
MAX_TRANSLATION = 0.2  # a frame: 6 m/s at 30 Hz
MAX_ROTATION = 0.25  # radians a frame: 430 degrees a second at 30 Hz
# After a refusal: docs/research/tracking-checks.md.
RECOVERY_CHECKS = 10  # that pass, until the camera counts as found
KEPT_AGREEMENT = 0.9  # of the agreement with the model at the last check that passed
MOTION_PRIOR = 0.015  # squared metres an inlier, for each squared metre or radian from where ICP started
MOST_EXTRAPOLATED = 3  # checks that the last turn is believed to go on
SEARCH_AFTER = 10  # failed checks, from which on the second attempt starts around the kept pose
SEARCH_ANGLE = 0.2  # radians
RETRY_ITERATIONS = (10, 5, 4)  # of the second attempt, at least; finest level first
# Of configurations that adapt: docs/research/adaptive.md.
MOST_SKIPPED = 5  # frames, one after another
SKIPPING_INLIERS = 0.85  # of their share's maximum, which decays by SHARE_DECAY with each tracked frame
SHARE_DECAY = 0.98
CAUTIOUS_FRAMES = 8  # tracked ones after which frames are left out again, once one lay where none expected it
EARLY_FRAMES = 4  # tracked ones that are always fused
MAX_WEIGHT = 100.0
NEAR_PLANE = 0.4
FAR_PLANE = 4.0
FRAMES_WITHOUT_TRACKING = 4  # frames 0 to 3 are integrated where the camera starts
LEVELS = 3


@dataclass(frozen=True)
class Configuration(Parameters):
    """One point of the design space; the defaults are SLAMBench's.

    compute_size_ratio: depth is sampled at every n-th pixel, unaveraged. integration_rate: frame n is
    fused when n % rate == 0. tracking_rate: likewise for ICP. icp_threshold: a level's iterations end
    when the norm of the update (metres and radians) falls below it; 0 never ends them early.
    mu: truncation distance, m. volume_resolution: voxels per side. pyramid_iterations_*: ICP
    iterations at full, half and quarter size; they run from coarse to fine.

    skip_limit: at most so many frames in a row are left out while the camera moves little; 0 never.
    skip_translation, skip_rotation: how little, m and rad. integrate_translation, integrate_rotation: a frame
    is fused when the camera is farther from where one was fused last, m or rad; one of them 0: by the other
    alone; both 0: by its number.

    raycast_after_fusion: 1: rays are cast only after a frame that may be fused, and tracking sees the model
    from where they began. 0: after every frame.
    """

    system: ClassVar[str] = "KinectFusion"

    compute_size_ratio: int = 1
    integration_rate: int = 2
    tracking_rate: int = 1
    icp_threshold: float = 1e-5
    mu: float = 0.1
    volume_resolution: int = 256
    pyramid_iterations_fine: int = 10
    pyramid_iterations_middle: int = 5
    pyramid_iterations_coarse: int = 4
    skip_limit: int = 0
    skip_translation: float = 0.0
    skip_rotation: float = 0.0
    integrate_translation: float = 0.0
    integrate_rotation: float = 0.0
    raycast_after_fusion: int = 0

    def __post_init__(self) -> None:
        for name, least in _WHOLE.items():
            object.__setattr__(self, name, whole(name, getattr(self, name), least))
        for name in ("mu", "icp_threshold", *ADAPTIVE[1:]):
            object.__setattr__(self, name, finite(name, getattr(self, name)))
        if self.mu <= 0:
            raise ConfigurationError(f"mu={self.mu!r}: must be above 0 (metres)")
        if self.icp_threshold < 0:
            raise ConfigurationError(f"icp_threshold={self.icp_threshold!r}: must be 0 or more")
        if sum(self.iterations) == 0:
            raise ConfigurationError(
                "all three pyramid_iterations are 0: give at least one level an iteration"
            )
        if self.raycast_after_fusion not in (0, 1):
            raise ConfigurationError(f"raycast_after_fusion={self.raycast_after_fusion}: must be 0 or 1")
        self._check_adaptive()

    def _check_adaptive(self) -> None:
        for name in ADAPTIVE:
            if getattr(self, name) < 0:
                raise ConfigurationError(f"{name}={getattr(self, name)!r}: must be 0 or more")
        if self.skip_limit > MOST_SKIPPED:
            raise ConfigurationError(f"skip_limit={self.skip_limit}: must be at most {MOST_SKIPPED}")
        if self.skip_limit and self.tracking_rate != 1:
            raise ConfigurationError(
                f"skip_limit={self.skip_limit} with tracking_rate={self.tracking_rate}: frames are left out "
                "by motion or by their number; set tracking_rate to 1, or skip_limit to 0"
            )
        if self.skip_limit and self.integration_rate != 1:
            raise ConfigurationError(
                f"skip_limit={self.skip_limit} with integration_rate={self.integration_rate}: frames that "
                "would be fused may be left out; set integration_rate to 1, or skip_limit to 0"
            )
        if self.integrates_by_motion and self.integration_rate != 1:
            raise ConfigurationError(
                f"integration_rate={self.integration_rate} with integrate_translation="
                f"{self.integrate_translation} and integrate_rotation={self.integrate_rotation}: frames are "
                "fused by motion or by their number; set integration_rate to 1, or the other two to 0"
            )

    @property
    def integrates_by_motion(self) -> bool:
        """Whether the camera's motion decides which frames are fused."""
        return self.integrate_translation > 0 or self.integrate_rotation > 0

    @property
    def adapts(self) -> bool:
        """Whether the motion decides anything."""
        return self.skip_limit > 0 or self.integrates_by_motion

    def to_dict(self) -> dict[str, Any]:
        """The parameters by name. Those of OPTIONAL that are 0 are omitted."""
        every = super().to_dict()
        return {name: value for name, value in every.items() if value or name not in OPTIONAL}

    @property
    def iterations(self) -> tuple[int, int, int]:
        """ICP iterations, finest level first, as SLAMBench writes them."""
        return (self.pyramid_iterations_fine, self.pyramid_iterations_middle, self.pyramid_iterations_coarse)


ADAPTIVE = ("skip_limit", "skip_translation", "skip_rotation", "integrate_translation", "integrate_rotation")
OPTIONAL = (*ADAPTIVE, "raycast_after_fusion")
_WHOLE = {
    "skip_limit": 0,
    "raycast_after_fusion": 0,
    "compute_size_ratio": 1,
    "integration_rate": 1,
    "tracking_rate": 1,
    "volume_resolution": 8,
    "pyramid_iterations_fine": 0,
    "pyramid_iterations_middle": 0,
    "pyramid_iterations_coarse": 0,
}

DEFAULT = Configuration()


def _android(ratio: int, threshold: float, rate: int, mu: float, pyramid: str, volume: int) -> Configuration:
    fine, middle, coarse = (int(count) for count in pyramid.split(","))
    return Configuration(
        compute_size_ratio=ratio,
        icp_threshold=threshold,
        integration_rate=rate,
        mu=mu,
        pyramid_iterations_fine=fine,
        pyramid_iterations_middle=middle,
        pyramid_iterations_coarse=coarse,
        volume_resolution=volume,
    )


# What the published Android app ran on 83 devices (read from the app's own list). STANDARD is the
# default of the crowd; DEFAULT above is the default of the design space.
STANDARD = _android(2, 1e-5, 2, 0.1, "10,5,4", 256)
ANDROID_APP = {
    "STANDARD": STANDARD,
    "FAST1": _android(4, 32.8116, 24, 0.419017, "4,2,0", 128),
    "FAST2": _android(4, 55.7286, 21, 0.407327, "9,6,3", 256),
    "FAST3": _android(2, 24.9643, 22, 0.430125, "6,4,5", 128),
    "FAST4": _android(4, 32.3618, 9, 0.147881, "11,11,6", 512),
}
