"""The camera's motion since the last frame: rotation first, then the full motion, and whether to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.devices.opencl import Session
from slam.elasticfusion import configuration as constants
from slam.elasticfusion.configuration import Configuration
from slam.elasticfusion.images import RgbdImage
from slam.elasticfusion.tracking.odometry import Odometry, Registration
from slam.elasticfusion.tracking.pyramid import Pyramid
from slam.elasticfusion.tracking.rotation import RotationAlignment


@dataclass(frozen=True)
class Step:
    """The motion (4, 4) of the camera since the last frame: from its new frame to its old one.

    good: whether the registration is accurate enough to use.
    """

    motion: NDArray[np.float64]
    good: bool


class Tracking:
    """Registers the live image to what the map showed at the last pose."""

    def __init__(
        self, session: Session, configuration: Configuration, live: RgbdImage, model: RgbdImage
    ) -> None:
        self._weight = configuration.icp_weight
        self._live = Pyramid(session, live)
        self._model = Pyramid(session, model)
        self._alignment = None if configuration.disable_so3 else RotationAlignment(session, self._live)
        self._odometry = Odometry(
            session, self._live, self._model, configuration.icp_weight, fast=configuration.fast_odometry
        )

    def begin(self) -> None:
        """Keep the live image for the comparison with the next, without tracking."""
        self._live.build()
        if self._alignment:
            self._alignment.remember()

    def track(self) -> Step:
        """The motion since the last frame; the identity where the registration gives an impossible one."""
        self._live.build()
        self._model.build()
        start = np.eye(4)
        if self._alignment:
            start[:3, :3] = self._alignment.align()
            self._alignment.remember()
        registration = self._odometry.register(start)
        if not self._possible(registration):
            return Step(np.eye(4), good=False)
        return Step(registration.pose, self._certain(registration))

    def _possible(self, registration: Registration) -> bool:
        step = float(np.linalg.norm(registration.pose[:3, 3]))
        by_colour = self._weight < constants.ICP_ONLY
        return bool(
            registration.icp_inliers + registration.rgb_inliers > 0
            and not (by_colour and step > constants.LARGEST_RGB_STEP)
        )

    def _certain(self, registration: Registration) -> bool:
        by_depth = self._weight > 0
        return bool(
            not (by_depth and registration.icp_error > constants.LOST_ICP_ERROR)
            and registration.is_certain(constants.LOST_DEVIATION)
        )
