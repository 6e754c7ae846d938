"""A model of the Kinect: quantised disparity, jitter, shadows, dropouts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slam.camera import Camera

# The first Kinect measures 1/8 pixel of disparity with a baseline of 75 mm: z = 351.3 / (disparity in
# eighths of a pixel), steps of 3 mm at 1 m and 26 mm at 3 m.
DISPARITY = 351.3  # metres times eighths of a pixel
BASELINE = 0.075  # metres between projector and sensor
NEAREST, FARTHEST = 0.4, 4.5  # metres
GRAZING = 75.0, 86.0  # degrees of incidence between which returns fade away
EDGE = 0.03  # relative step of depth between neighbours that makes an edge
WAVES = 4  # smooth waves over the image that make up a sensor's distortion
MOST_CYCLES = 1.5  # of such a wave over the width or height of the image


@dataclass(frozen=True)
class Sensor:
    """The quality of a Kinect. Disparities are in eighths of a pixel.

    disparity_sigma: random error of the disparity. distortion: amplitude of a smooth, constant error of the
    disparity over the image, as a poor calibration leaves it. lateral_sigma: pixels. edge_dropout: share of
    the pixels at an edge without a measurement; dropout: of all pixels. faintest: the weakest return that is
    sure to be measured, as a fraction of what a white surface sends back head-on from 1 m; below it
    measurements become rarer and end at half of it. 0 measures every return.
    """

    disparity_sigma: float = 1 / 6
    distortion: float = 0.0
    lateral_sigma: float = 0.5
    edge_dropout: float = 0.4
    dropout: float = 0.003
    faintest: float = 0.0


KINECT = Sensor()


def measure(
    depth: npt.NDArray[np.float64],
    blind: npt.NDArray[np.bool_],
    camera: Camera,
    rng: np.random.Generator,
    sensor: Sensor = KINECT,
    albedo: npt.NDArray[np.float64] | None = None,
    unit_distortion: npt.NDArray[np.float64] | None = None,
) -> npt.NDArray[np.uint16]:
    """Depth (h, w) in millimetres, 0 where nothing is measured, of exact depth in metres.

    `blind` (h, w) marks surfaces that send no light back, such as glass. Infinite depth is allowed.
    `albedo` (h, w) is the share of light that surfaces send back (default 1), `unit_distortion` (h, w) the
    shape of the sensor's distortion (default none).
    """
    cosine = _cosine(depth, camera)
    missing = blind | _shadow(depth, camera) | _faded(cosine, rng)
    missing |= _edges(depth) & (rng.random(depth.shape) < sensor.edge_dropout)
    missing |= rng.random(depth.shape) < sensor.dropout

    rows, columns = np.mgrid[: camera.height, : camera.width]
    columns = _jittered(columns, camera.width - 1, sensor.lateral_sigma, rng)
    rows = _jittered(rows, camera.height - 1, sensor.lateral_sigma, rng)
    jittered = depth[rows, columns]
    exact = DISPARITY / jittered
    if unit_distortion is not None:
        exact = exact + sensor.distortion * unit_distortion
    disparity = np.floor(exact + rng.normal(0, sensor.disparity_sigma, depth.shape) + 0.5)
    missing |= disparity < DISPARITY / FARTHEST
    missing |= disparity > DISPARITY / NEAREST
    if sensor.faintest > 0:
        returned = (1.0 if albedo is None else albedo) * cosine / depth**2
        missing |= rng.random(depth.shape) > 2 * returned / sensor.faintest - 1
    millimetres = np.rint(1000 * DISPARITY / np.maximum(disparity, 1))
    return np.where(missing, 0, millimetres).astype(np.uint16)


def make_distortion(camera: Camera, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """A smooth random error over the image, (height, width), with a root mean square of about 1."""
    v, u = np.mgrid[: camera.height, : camera.width]
    total = np.zeros((camera.height, camera.width))
    for _ in range(WAVES):
        across, down = rng.uniform(-MOST_CYCLES, MOST_CYCLES, 2)
        phase = rng.uniform(0, 2 * np.pi)
        total += np.sin(2 * np.pi * (across * u / camera.width + down * v / camera.height) + phase)
    distortion: npt.NDArray[np.float64] = total / np.sqrt(WAVES / 2)
    return distortion


def _jittered(
    pixels: npt.NDArray[np.intp], last: int, sigma: float, rng: np.random.Generator
) -> npt.NDArray[np.intp]:
    """The pixels whose depth is really measured: the sensor's optics and correlation window blur."""
    return np.clip(np.rint(pixels + rng.normal(0, sigma, pixels.shape)), 0, last).astype(np.intp)


def _shadow(depth: npt.NDArray[np.float64], camera: Camera) -> npt.NDArray[np.bool_]:
    """The pixels where the projector, to the right of the sensor, is hidden by something nearer."""
    seen_from_projector = np.arange(depth.shape[1]) - camera.fx * BASELINE / depth
    hiding = np.minimum.accumulate(seen_from_projector[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(seen_from_projector > hiding + 0.5)


def _cosine(depth: npt.NDArray[np.float64], camera: Camera) -> npt.NDArray[np.float64]:
    """Of the angle (h, w) between each ray and the normal of the surface that it meets."""
    finite = np.where(np.isfinite(depth), depth, FARTHEST)
    across, down = np.gradient(finite, axis=1), np.gradient(finite, axis=0)
    v, u = np.mgrid[: camera.height, : camera.width]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    # With the ray r = (x, y, 1) the surface z r has, up to its length, the normal
    # (-fx z_u, -fy z_v, z + x fx z_u + y fy z_v), whose product with r is z.
    nx, ny = camera.fx * across, camera.fy * down
    nz = finite + x * nx + y * ny
    return np.asarray(finite / np.sqrt((nx**2 + ny**2 + nz**2) * (x**2 + y**2 + 1)))


def _faded(cosine: npt.NDArray[np.float64], rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Surfaces seen at a grazing angle return too little light, more often the flatter the angle."""
    angle = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    fading = (angle - GRAZING[0]) / (GRAZING[1] - GRAZING[0])
    return np.asarray(rng.random(cosine.shape) < fading)


def _edges(depth: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Both pixels of every pair of neighbours between which the depth jumps."""
    edges = np.zeros(depth.shape, bool)
    for image, marked in ((depth, edges), (depth.T, edges.T)):
        with np.errstate(invalid="ignore"):
            jump = np.abs(np.diff(image, axis=0)) > EDGE * np.minimum(image[:-1], image[1:])
        marked[:-1] |= jump
        marked[1:] |= jump
    return edges
