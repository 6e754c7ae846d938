"""Registers one RGB-D image to another: ICP and brightness together, without leaving the device."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.dense.images import intrinsics
from slam.devices.layout import SUMS
from slam.devices.opencl import BoundKernel, Session
from slam.elasticfusion.configuration import ICP_ONLY, ITERATIONS, LOOP_ICP_WEIGHT, REFERENCE_PIXELS
from slam.elasticfusion.tracking.pyramid import Pyramid, PyramidLevel

SOURCE = Path(__file__).parents[1] / "kernels" / "odometry.cl"
ASSOCIATION_DISTANCE = 0.10  # metres between partners of ICP
ASSOCIATION_NORMAL = float(np.cos(np.deg2rad(20)))  # product of their normals
DEPTH_DIFFERENCE = 0.07  # metres between pixels whose brightness is compared
PHOTOMETRIC_FARTHEST = 6.0  # metres
LEAST_GRADIENTS = (5.0, 3.0, 1.0)  # grey levels per pixel, finest level first
# Of a brightness difference relative to a distance of 1 m: at w = 10 a difference as large as its noise
# counts like 2.5 mm, about the noise of a depth camera.
RGB_WEIGHT = 0.05
CONVERGED = 1e-4  # norm of the update, metres and radians: a tenth of what a depth image resolves
# Errors of neighbouring pixels are correlated: a sensor matches patches, and a model bends as a whole. So
# many pixels of an image of REFERENCE_PIXELS, a square of 20 x 20, count as one measurement in the deviations
# of a pose.
CORRELATED_PIXELS = 400
LEAST_DEPTH_NOISE = 1e-3  # metres: depth images hold whole millimetres

# The layout of the struct Estimate in `odometry.cl`.
ESTIMATE = np.dtype(
    [
        ("pose", np.float32, 12),
        ("normal_matrix", np.float32, 21),
        ("icp_squared_error", np.float32),
        ("icp_inliers", np.float32),
        ("rgb_squared_error", np.float32),
        ("rgb_inliers", np.float32),
        ("noise", np.float32),
        ("converged", np.int32),
    ]
)


@dataclass(frozen=True)
class Registration:
    """The source's pose in the target's frame, and the quality of the fit.

    pose: float64 (4, 4), source camera to target camera. icp_error: sqrt(sum r^2) / inliers of the
    point-to-plane distances r (metres); infinite without inliers. icp_inliers, rgb_inliers: pixels. All are
    of the finest level's last iteration, and what 640x480 pixels would have given.

    position_deviation, rotation_deviation: standard deviation of the camera's position (metres) and of its
    rotation (radians), each in the direction that is least certain; infinite where nothing constrains the
    camera.
    """

    pose: NDArray[np.float64]
    icp_error: float
    icp_inliers: float
    rgb_inliers: float
    position_deviation: float
    rotation_deviation: float

    def is_certain(self, deviation: float) -> bool:
        """Whether one standard deviation moves the camera by at most `deviation` metres, and also, by
        turning, a point at one metre.
        """
        return self.position_deviation <= deviation and self.rotation_deviation <= deviation


class Odometry:
    """Gauss-Newton from coarse to fine on E = w^2 E_icp + E_rgb, w = `icp_weight`.

    w = 0 leaves the geometry out, ICP_ONLY or more the brightness: w is then LOOP_ICP_WEIGHT, which changes
    nothing but the scale of the normal equations.
    `iterations` are those of each level, finest first. With `fast`, brightness counts on the finest level
    alone, which is the single level of the published flag; the coarser ones then find the way by geometry.
    """

    def __init__(
        self,
        session: Session,
        source: Pyramid,
        target: Pyramid,
        icp_weight: float,
        iterations: tuple[int, ...] = ITERATIONS,
        fast: bool = False,
    ) -> None:
        self._session = session
        rgb_weight = RGB_WEIGHT if icp_weight < ICP_ONLY else 0.0
        icp_weight = icp_weight if rgb_weight else LOOP_ICP_WEIGHT
        self._icp_weight = icp_weight
        finest = source.levels[0].camera
        self._pixels = finest.width * finest.height
        most, _, _ = session.layout.sums(finest.width, finest.height)
        self._records = session.buffer(4 * SUMS * most, "the normal equations")
        self._columns = session.buffer(4 * self._pixels, "a list of pixels")
        self._counts = session.buffer(4 * finest.height, "a list of pixels")
        self._estimate = session.buffer(ESTIMATE.itemsize, "the pose")
        self._kernels: list[BoundKernel] = []
        levels = list(zip(source.levels, target.levels, iterations, strict=False))
        noise_known = False
        for size, (fine, onto, rounds) in reversed(list(enumerate(levels))):
            weights = (icp_weight, rgb_weight if size == 0 or not fast else 0.0)
            if rounds == 0 or not any(weights):
                continue
            if weights[1]:
                self._kernels.append(
                    self._listing(fine, LEAST_GRADIENTS[min(size, len(LEAST_GRADIENTS) - 1)])
                )
            if weights[1] and not noise_known:
                self._kernels += self._measuring(fine, onto)
                noise_known = True
            for iteration in range(rounds):
                self._kernels += self._iteration(fine, onto, weights, iteration)

    def register(self, start: NDArray[np.float64]) -> Registration:
        """Run all of it from `start` (4, 4), source camera to target camera, on what the pyramids hold now.

        Unconstrained directions stay at the start. After an overflow the pose stays at the start, without
        inliers.
        """
        estimate = np.zeros((), ESTIMATE)
        estimate["pose"], estimate["noise"] = start[:3].ravel(), 1
        self._session.upload(self._estimate, estimate)
        for kernel in self._kernels:
            kernel()
        self._session.download(self._estimate, estimate)
        finite = all(np.isfinite(estimate[name]).all() for name in ESTIMATE.fields or ())
        return self._registration(estimate) if finite else _nothing(start)

    def _listing(self, level: PyramidLevel, least_gradient: float) -> BoundKernel:
        camera = level.camera
        return self._session.kernel(
            SOURCE, "list_steep_pixels", (camera.height,), level.depth, level.gradient_x, level.gradient_y,
            camera.width, least_gradient, PHOTOMETRIC_FARTHEST, self._columns, self._counts,
        )  # fmt: skip

    def _measuring(self, source: PyramidLevel, target: PyramidLevel) -> list[BoundKernel]:
        count, equations = self._equations(source, target, (0.0, 1.0), 0)
        noise = self._session.kernel(SOURCE, "measure_noise", (1,), self._records, count, self._estimate)
        return [equations, noise]

    def _iteration(
        self, source: PyramidLevel, target: PyramidLevel, weights: tuple[float, float], iteration: int
    ) -> list[BoundKernel]:
        count, equations = self._equations(source, target, weights, iteration)
        solve = self._session.kernel(
            SOURCE, "solve", (1,), self._records, count, CONVERGED, iteration, self._estimate
        )
        return [equations, solve]

    def _equations(
        self, source: PyramidLevel, target: PyramidLevel, weights: tuple[float, float], iteration: int
    ) -> tuple[int, BoundKernel]:
        """The number of records that it leaves, and the kernel; weights of geometry and of brightness."""
        count, size, group = self._session.layout.sums(source.camera.width, source.camera.height)
        return count, self._session.kernel(
            SOURCE, "equations", size, *_arguments(source), *_arguments(target), self._columns, self._counts,
            *weights, ASSOCIATION_DISTANCE, ASSOCIATION_NORMAL, DEPTH_DIFFERENCE, iteration, self._estimate,
            self._records, group=group,
        )  # fmt: skip

    def _registration(self, estimate: NDArray[np.void]) -> Registration:
        scale = REFERENCE_PIXELS / self._pixels
        pose = np.eye(4)
        pose[:3] = estimate["pose"].reshape(3, 4)
        left, _, right = np.linalg.svd(pose[:3, :3])  # orthonormal to double precision
        pose[:3, :3] = left @ right
        inliers = float(estimate["icp_inliers"])
        rgb_inliers = float(estimate["rgb_inliers"])
        squared_error = float(estimate["icp_squared_error"])
        position, rotation = pose_deviations(
            estimate["normal_matrix"].astype(np.float64) * scale / CORRELATED_PIXELS,
            residual_variance(squared_error, inliers, rgb_inliers, self._icp_weight),
        )
        return Registration(
            pose,
            icp_error=np.sqrt(squared_error) / inliers / np.sqrt(scale) if inliers else float("inf"),
            icp_inliers=inliers * scale,
            rgb_inliers=rgb_inliers * scale,
            position_deviation=position,
            rotation_deviation=rotation,
        )


def _nothing(start: NDArray[np.float64]) -> Registration:
    """The result of a failed registration."""
    return Registration(start.copy(), float("inf"), 0.0, 0.0, float("inf"), float("inf"))


def residual_variance(
    icp_squared_error: float, icp_inliers: float, rgb_inliers: float, icp_weight: float
) -> float:
    """The larger mean square of the two kinds of weighted residuals, in the scale of the normal equations.

    0 without inliers. `icp_squared_error` is the sum of squared distances (m^2); noise below
    LEAST_DEPTH_NOISE is raised to it. A difference of brightness r counts RGB_WEIGHT |r| / (noise + |r|),
    where noise is the root mean square of r. Its square is concave in r^2, so its mean is at most (RGB_WEIGHT
    / 2)^2, which is used. The larger of the two bounds the covariance where depth constrains one direction
    and brightness another.
    """
    by_depth, by_brightness = 0.0, 0.0
    if icp_inliers:
        by_depth = icp_weight**2 * max(icp_squared_error / icp_inliers, LEAST_DEPTH_NOISE**2)
    if rgb_inliers:
        by_brightness = (RGB_WEIGHT / 2) ** 2
    return max(by_depth, by_brightness)


def pose_deviations(upper: NDArray[np.float64], variance: float) -> tuple[float, float]:
    """The largest standard deviations of position (metres) and of rotation (radians), of any direction.

    `upper` is the upper triangle (21,) of the normal matrix J^T J, translation first, `variance` that of the
    residuals. The pose's covariance is variance * (J^T J)^-1: a common factor of all weights cancels out.
    Infinite where a direction of (nearly) no information has a part in it.
    """
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = upper
    values, vectors = np.linalg.eigh(matrix, UPLO="U")
    known = values > max(1e-7 * values[-1], np.finfo(np.float64).tiny)
    blind, seen = vectors[:, ~known], vectors[:, known]
    covariance = variance * (seen / values[known]) @ seen.T

    def largest(part: slice) -> float:
        if (blind[part] ** 2).sum() > 1e-6:
            return float("inf")
        return float(np.sqrt(np.linalg.eigvalsh(covariance[part, part])[-1]))

    return largest(slice(0, 3)), largest(slice(3, 6))


def _arguments(level: PyramidLevel) -> tuple[object, ...]:
    camera = level.camera
    images = (level.depth, *level.normals, level.intensity, level.gradient_x, level.gradient_y)
    return (*images, camera.width, camera.height, intrinsics(camera))
