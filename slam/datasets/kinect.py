"""What a Kinect makes of exact depth: quantised disparity, jitter, shadows, dropouts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from slam.camera import Camera

# The first Kinect measures 1/8 pixel of disparity with a baseline of 75 mm: z = 351.3 / (disparity in
# eighths of a pixel), steps of 3 mm at 1 m and 26 mm at 3 m.
DISPARITY = 351.3  # metres times eighths of a pixel
BASELINE = 0.075  # metres between projector and sensor
DISPARITY_SIGMA = 1 / 6  # eighths of a pixel
LATERAL_SIGMA = 0.5  # pixels
NEAREST, FARTHEST = 0.4, 4.5  # metres
GRAZING = 75.0, 86.0  # degrees of incidence between which returns fade away
EDGE = 0.03  # relative step of depth between neighbours that makes an edge
EDGE_DROPOUT = 0.4  # share of the pixels at an edge without a measurement
DROPOUT = 0.003  # share of all pixels without a measurement for no visible reason


def measure(
    depth: npt.NDArray[np.float64],
    blind: npt.NDArray[np.bool_],
    camera: Camera,
    rng: np.random.Generator,
) -> npt.NDArray[np.uint16]:
    """Depth (h, w) in millimetres, 0 where nothing is measured, of exact depth in metres.

    `blind` (h, w) marks surfaces that send no light back, such as glass. Infinite depth is allowed.
    """
    missing = blind | _shadow(depth, camera) | _faded(depth, camera, rng)
    missing |= _edges(depth) & (rng.random(depth.shape) < EDGE_DROPOUT)
    missing |= rng.random(depth.shape) < DROPOUT

    rows, columns = np.mgrid[: camera.height, : camera.width]
    columns = _jittered(columns, camera.width - 1, rng)
    rows = _jittered(rows, camera.height - 1, rng)
    jittered = depth[rows, columns]
    disparity = np.floor(DISPARITY / jittered + rng.normal(0, DISPARITY_SIGMA, depth.shape) + 0.5)
    missing |= disparity < DISPARITY / FARTHEST
    missing |= disparity > DISPARITY / NEAREST
    millimetres = np.rint(1000 * DISPARITY / np.maximum(disparity, 1))
    return np.where(missing, 0, millimetres).astype(np.uint16)


def _jittered(pixels: npt.NDArray[np.intp], last: int, rng: np.random.Generator) -> npt.NDArray[np.intp]:
    """The pixels whose depth is really measured: the sensor's optics and correlation window blur."""
    return np.clip(np.rint(pixels + rng.normal(0, LATERAL_SIGMA, pixels.shape)), 0, last).astype(np.intp)


def _shadow(depth: npt.NDArray[np.float64], camera: Camera) -> npt.NDArray[np.bool_]:
    """Where the projector, which stands to the right of the sensor, is hidden by something nearer."""
    seen_from_projector = np.arange(depth.shape[1]) - camera.fx * BASELINE / depth
    hiding = np.minimum.accumulate(seen_from_projector[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(seen_from_projector > hiding + 0.5)


def _faded(depth: npt.NDArray[np.float64], camera: Camera, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Surfaces seen at a grazing angle return too little light, more often the flatter the angle."""
    finite = np.where(np.isfinite(depth), depth, FARTHEST)
    across, down = np.gradient(finite, axis=1), np.gradient(finite, axis=0)
    v, u = np.mgrid[: camera.height, : camera.width]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    # With the ray r = (x, y, 1) the surface z r has, up to its length, the normal
    # (-fx z_u, -fy z_v, z + x fx z_u + y fy z_v), whose product with r is z.
    nx, ny = camera.fx * across, camera.fy * down
    nz = finite + x * nx + y * ny
    cosine = finite / np.sqrt((nx**2 + ny**2 + nz**2) * (x**2 + y**2 + 1))
    angle = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    fading = (angle - GRAZING[0]) / (GRAZING[1] - GRAZING[0])
    return np.asarray(rng.random(depth.shape) < fading)


def _edges(depth: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Both pixels of every pair of neighbours between which the depth jumps."""
    edges = np.zeros(depth.shape, bool)
    for image, marked in ((depth, edges), (depth.T, edges.T)):
        with np.errstate(invalid="ignore"):
            jump = np.abs(np.diff(image, axis=0)) > EDGE * np.minimum(image[:-1], image[1:])
        marked[:-1] |= jump
        marked[1:] |= jump
    return edges
