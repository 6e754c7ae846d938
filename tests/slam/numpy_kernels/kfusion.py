"""Every kernel of slam.kfusion in NumPy, under its own name: slow, and obviously right.

Images are (height, width), vector images (height, width, 3), poses (4, 4) camera to volume, all float64;
the volume is float64 (z, y, x) distances in units of one truncation distance, with weights beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.kfusion.refusals import Refusal
from tests.slam.numpy_kernels.dense import (
    exponential,
    nearest_pixel,
    point_to_plane,
    solve_symmetric,
    vertex_map,
)

Array = NDArray[np.float64]


def farthest_of_rows(metres: Array) -> Array:
    """The largest depth of each row."""
    return metres.max(axis=1)


def farthest_of_tiles(metres: Array, tile: int) -> Array:
    """The largest depth of each of `tile` x `tile` pixels."""
    height, width = metres.shape
    padded = np.pad(metres, ((0, -height % tile), (0, -width % tile)))
    return padded.reshape(padded.shape[0] // tile, tile, -1, tile).max(axis=(1, 3))


def farthest_depth(rows: Array) -> float:
    """The largest depth of the image, from that of each row."""
    return float(rows.max())


def view_from(pose: Array, camera: Camera) -> Array:
    """The view (3, 4) from `pose`: from the volume's frame to pixels of the camera, times their depth."""
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    return matrix @ np.linalg.inv(pose)[:3]


def begin_retry(pose: Array, misses: int, search_after: int, search_angle: float) -> Array:
    """Where a frame's second attempt starts after `misses` failed checks before it."""
    if misses < search_after:
        return pose
    right, down = np.cos(misses * np.pi / 4), np.sin(misses * np.pi / 4)
    return turned(pose, search_angle * pose[:3, :3] @ [right, down, 0])


def turned(pose: Array, vector: Array) -> Array:
    """A camera turned where it stands, by a rotation vector in the volume's axes."""
    rotated = pose.copy()
    rotated[:3, :3] = exponential(np.array([0, 0, 0, *vector]))[:3, :3] @ pose[:3, :3]
    return rotated


def rotation_between(before: Array, after: Array) -> Array:
    """The rotation vector that turns `before`'s axes into `after`'s: less than pi radians."""
    turn = after[:3, :3] @ before[:3, :3].T
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    length = np.linalg.norm(axis)
    return axis * np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)) / length if length > 0 else axis


def track(
    depth: Array,
    normals: Array,
    camera: Camera,
    model_vertices: Array,
    model_normals: Array,
    pose: Array,
    view: Array,
    max_distance: float,
    min_dot: float,
) -> tuple[Array, Array, float, int, int]:
    """The normal equations of point-to-plane ICP.

    Returns J^T J (6, 6), J^T e (6), the sum of e^2, the number of inliers and that of the pixels that see
    the model; the unknowns are a translation and a rotation vector about the volume's origin.
    """
    normal_matrix, right_side, squared_error, inliers, overlap = np.zeros((6, 6)), np.zeros(6), 0.0, 0, 0
    vertices = vertex_map(depth, camera)
    height, width = model_vertices.shape[:2]
    for source_pixel in np.ndindex(depth.shape):
        point = pose[:3, :3] @ vertices[source_pixel] + pose[:3, 3]
        pixel = nearest_pixel(view @ np.append(point, 1.0), width, height)
        if pixel is None:
            continue
        overlap += bool(depth[source_pixel] > 0 and model_normals[pixel].any())
        row = point_to_plane(
            point, pose[:3, :3] @ normals[source_pixel], model_vertices[pixel], model_normals[pixel],
            max_distance, min_dot,
        )  # fmt: skip
        if row is None:
            continue
        jacobian, error = row
        normal_matrix += np.outer(jacobian, jacobian)
        right_side += jacobian * error
        squared_error += error**2
        inliers += 1
    return normal_matrix, right_side, squared_error, inliers, overlap


def solve(normal_matrix: Array, right_side: Array, pose: Array, threshold: float) -> tuple[Array, bool]:
    """The moved pose, and whether the update was smaller than the threshold."""
    update = solve_symmetric(normal_matrix, right_side)
    return exponential(update) @ pose, bool(np.linalg.norm(update) < threshold)


def add_prior(
    normal_matrix: Array,
    right_side: Array,
    inliers: int,
    prior: float,
    checks: int,
    start: Array,
    pose: Array,
) -> tuple[Array, Array]:
    """The normal equations with six more rows: the camera's way from `start`, in metres and radians.

    Each costs `prior` times the `inliers`, over the square of the `checks` since the pose was known.
    """
    x, y, z = pose[:3, 3]
    across = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])  # rotation vector x position
    jacobian = np.block([[np.eye(3), across], [np.zeros((3, 3)), np.eye(3)]])
    away = np.concatenate([pose[:3, 3] - start[:3, 3], rotation_between(start, pose)])
    weight = prior * inliers / checks**2
    return normal_matrix + weight * jacobian.T @ jacobian, right_side - weight * jacobian.T @ away


@dataclass(frozen=True)
class Limits:
    """The parameters of `check_pose`."""

    pixels: int
    max_residual: float
    min_inliers: float
    near_motion: float
    far_inliers: float
    kept_inliers: float
    kept_agreement: float
    max_translation: float
    max_rotation: float
    volume_size: float


def check_pose(
    before: Array,
    after: Array,
    limits: Limits,
    *,
    squared_error: float,
    inliers: int,
    overlap: int = 0,
    misses: int = 0,
    last_inliers: float = 0,
    last_agreement: float = 0,
    recovering: bool = False,
    retrying: bool = False,
) -> Refusal | None:
    """The first rule that refuses the pose `after`, None where all pass."""
    share, checks = inliers / limits.pixels, misses + 1
    translation = np.linalg.norm(after[:3, 3] - before[:3, 3])
    rotation = np.linalg.norm(rotation_between(before, after))
    if recovering:
        agrees = inliers / max(overlap, 1) >= limits.kept_agreement * last_agreement
        enough = agrees and (not retrying or share >= limits.far_inliers)
    else:
        enough = share >= max(limits.far_inliers, limits.kept_inliers * last_inliers)
    if share < limits.min_inliers:
        return Refusal.INLIERS
    if not np.sqrt(squared_error / inliers) <= limits.max_residual:
        return Refusal.RESIDUAL
    if not translation <= limits.max_translation * checks:
        return Refusal.TRANSLATION
    if rotation > limits.max_rotation * checks:
        return Refusal.ROTATION
    if translation + rotation > limits.near_motion and not enough:
        return Refusal.FAR_MOTION
    if _inside(before, limits.volume_size) and not _inside(after, limits.volume_size):
        return Refusal.OUTSIDE
    return None


def _inside(pose: Array, volume_size: float) -> bool:
    return bool(((pose[:3, 3] >= 0) & (pose[:3, 3] <= volume_size)).all())


def empty_volume(resolution: int) -> tuple[Array, Array]:
    """Distances and weights of a volume that has observed nothing: empty space everywhere."""
    return np.ones((resolution,) * 3), np.zeros((resolution,) * 3)


def integrate(
    distances: Array,
    weights: Array,
    voxel_size: float,
    depth: Array,
    camera: Camera,
    pose: Array,
    mu: float,
    max_weight: float,
) -> tuple[Array, Array]:
    """Fuse a depth image (Newcombe et al. 2011, eq. 6 to 13); new distances and weights."""
    resolution = len(distances)
    z, y, x = np.mgrid[:resolution, :resolution, :resolution]
    centres = (np.stack([x, y, z], axis=-1) + 0.5) * voxel_size
    seen = (centres - pose[:3, 3]) @ pose[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        rays = seen / seen[..., 2:]
    u = camera.fx * rays[..., 0] + camera.cx + 0.5
    v = camera.fy * rays[..., 1] + camera.cy + 0.5
    visible = (seen[..., 2] > 1e-4) & (u >= 0) & (u <= camera.width - 1) & (v >= 0) & (v <= camera.height - 1)
    measured = np.zeros_like(distances)
    measured[visible] = depth[v[visible].astype(int), u[visible].astype(int)]
    along_ray = (measured - seen[..., 2]) * np.linalg.norm(rays, axis=-1)
    update = visible & (measured > 0) & (along_ray > -mu)
    mean = (distances * weights + np.minimum(along_ray / mu, 1)) / (weights + 1)
    return (
        np.where(update, np.maximum(mean, -1), distances),
        np.where(update, np.minimum(weights + 1, max_weight), weights),
    )


def dilate_blocks(marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Blocks (z, y, x) that are marked or have a marked neighbour towards larger indices."""
    padded = np.pad(marked, ((0, 1),) * 3)
    z, y, x = marked.shape
    searched = np.zeros_like(marked)
    for dz, dy, dx in np.ndindex(2, 2, 2):
        searched |= padded[dz : dz + z, dy : dy + y, dx : dx + x]
    return searched


def searched_blocks(near: NDArray[np.bool_], block: int) -> NDArray[np.bool_]:
    """The blocks of `block`^3 voxels in which an interpolation reads a voxel that is `near` a surface."""
    cells = dilate_blocks(near)
    sides = [range(0, side, block) for side in near.shape]
    return np.array(
        [[[cells[z : z + block, y : y + block, x : x + block].any() for x in sides[2]] for y in sides[1]]
         for z in sides[0]]
    )  # fmt: skip


def chessboard_distances(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many blocks each block is away from a `marked` one, diagonal steps counting 1; their number along x
    where there is none.
    """
    places = np.argwhere(marked)
    distances = np.full(marked.shape, marked.shape[0])
    for block in np.ndindex(marked.shape):
        if len(places):
            distances[block] = min(distances[block], abs(places - block).max(axis=1).min())
    return distances


def interpolate(distances: Array, point: Array, voxel_size: float) -> float:
    """Trilinear interpolation at a point in metres; beyond the outermost voxel centres, extrapolation."""
    position = point / voxel_size - 0.5
    base = np.clip(position.astype(int), 0, len(distances) - 2)
    fraction = position - base
    value = 0.0
    for corner in np.ndindex(2, 2, 2):
        value += np.prod(np.where(corner, fraction, 1 - fraction)) * distances[tuple((base + corner)[::-1])]
    return float(value)


def raycast(
    distances: Array,
    voxel_size: float,
    pose: Array,
    camera: Camera,
    near_plane: float,
    far_plane: float,
    small_step: float,
    large_step: float,
    near_surface: float = 0.8,
) -> tuple[Array, Array]:
    """Vertices and normals in the volume's frame; zero where a ray finds no surface.

    A ray's parameter is its depth along the optical axis; it keeps between the outermost voxel centres.
    It takes large steps until the distance falls below `near_surface` and small ones from then on; the
    first crossing from outside is interpolated.
    """
    vertices = np.zeros((camera.height, camera.width, 3))
    normals = np.zeros_like(vertices)
    margin = voxel_size / 2
    size = len(distances) * voxel_size
    for y, x in np.ndindex(camera.height, camera.width):
        direction = pose[:3, :3] @ [(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]
        origin = pose[:3, 3]
        with np.errstate(divide="ignore"):
            sides = np.sort([(margin - origin) / direction, (size - margin - origin) / direction], axis=0)
        t, end = max(sides[0].max(), near_plane), min(sides[1].min(), far_plane)
        step, before = large_step, None
        while t < end:
            value = interpolate(distances, origin + t * direction, voxel_size)
            if value < 0 or (before is None and value == 0):
                break
            if value < near_surface:
                step = small_step
            before = value
            t += step
        else:
            continue
        if before is None:  # the camera stands inside or behind a surface
            continue
        point = origin + (t + step * value / (before - value)) * direction
        offsets = np.eye(3) * voxel_size
        gradient = np.array(
            [
                interpolate(distances, point + offset, voxel_size)
                - interpolate(distances, point - offset, voxel_size)
                for offset in offsets
            ]
        )
        length = np.linalg.norm(gradient)
        if length > 0:
            vertices[y, x], normals[y, x] = point, gradient / length
    return vertices, normals
