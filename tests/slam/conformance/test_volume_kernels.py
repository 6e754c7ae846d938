"""The kernels of KinectFusion's volume give what their NumPy references give, on every device and backend."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from slam.camera import Camera
from slam.devices.layout import SUM_GROUP, Layout
from slam.kfusion.declarations import BLOCK, SCALE, TILE
from slam.kfusion.plan import NEAR_SURFACE, blocks_of
from tests.slam.conformance.values import camera_of, pose_at, state_of
from tests.slam.dense.scenes import CAMERA, MIRRORED, room_depth
from tests.slam.numpy_kernels import kfusion as reference

SIZE, RESOLUTION, MU = 2.4, 36, 0.25
VOXEL = SIZE / RESOLUTION
BLOCKS = blocks_of(RESOLUTION)


def stored(layout: Layout, distances: np.ndarray, weights: np.ndarray) -> dict[str, np.ndarray]:
    """A volume as `layout` stores it: by rows each voxel's distance below that of its neighbour in x, and the
    weights apart; by pixels both in one word.
    """
    scaled = np.rint(distances * SCALE).astype(np.int32)
    if layout.pixels:
        return {"voxels": (SCALE - scaled).astype(np.uint32) | weights.astype(np.uint32) << 16}
    low = (scaled & 0xFFFF).astype(np.uint32)
    next_in_x = np.concatenate([low[..., 1:], low[..., -1:]], axis=-1)
    return {"voxels": low | next_in_x << 16, "weights": weights.astype(np.uint8)}


def loaded(layout: Layout, volume: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Distances and weights of what `stored` gave."""
    low = volume["voxels"] & 0xFFFF
    if layout.pixels:
        return 1 - low / SCALE, volume["voxels"] >> 16
    return low.astype(np.uint16).view(np.int16) / SCALE, volume["weights"]


def quantised(distances: np.ndarray) -> np.ndarray:
    return np.rint(distances * SCALE) / SCALE


def marks_of(distances: np.ndarray) -> np.ndarray:
    marks = np.zeros((blocks_of(len(distances)),) * 3, np.int32)
    z, y, x = np.nonzero(distances < 0.8)
    marks[z // BLOCK, y // BLOCK, x // BLOCK] = 1
    return marks


def test_farthest_depth(launch, session):
    depth = np.random.default_rng(1).uniform(0, 9, (130, 40)).astype(np.float32)
    height, width = depth.shape
    rows, state = np.zeros(height, np.float32), state_of(np.eye(4))
    expected_tiles = reference.farthest_of_tiles(depth, TILE)
    tiles = {} if session.layout.pixels else {"tile_farthest": np.zeros_like(expected_tiles)}
    launch(
        "farthest_of_rows", session.layout.lines(height), metres=depth, width=width, height=height,
        row_farthest=rows, **tiles,
    )  # fmt: skip
    np.testing.assert_array_equal(rows, reference.farthest_of_rows(depth))
    for farthest in tiles.values():
        np.testing.assert_array_equal(farthest, expected_tiles)
    grid = session.layout.one_group(SUM_GROUP)
    launch("farthest_depth", grid, row_farthest=rows, height=height, state=state)
    assert state["farthest"] == reference.farthest_depth(rows)


def integrate(
    launch, session, volume, marks, depth, camera, state, max_weight=100.0, conditional=0, tiles=None
) -> None:
    layout = session.layout
    tiles = reference.farthest_of_tiles(depth, TILE) if tiles is None else tiles
    grid = layout.over(RESOLUTION, RESOLUTION) if layout.pixels else ((BLOCKS, BLOCKS), (1, 1))
    state["farthest"] = depth.max()
    seen = {} if layout.pixels else {"tile_farthest": tiles}
    launch(
        "integrate", grid, **volume, **seen, resolution=RESOLUTION, voxel_size=VOXEL, surface=marks,
        blocks=BLOCKS, depth=depth, width=camera.width, height=camera.height, camera=camera_of(camera), mu=MU,
        max_weight=max_weight, near_surface=NEAR_SURFACE, conditional=conditional, state=state,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, MIRRORED], ids=["plain", "mirrored"])
@pytest.mark.parametrize(
    "twist", [(0, 0, 0), (0.3, -0.4, 0.2), (0, 1.5707963, 0)], ids=["straight", "askew", "side"]
)
def test_integrate_twice(launch, session, camera, twist):
    pose = pose_at((1.2, 1.1, 0.15) if not twist[1] > 1 else (0.1, 1.1, 1.2), twist)
    distances, weights = reference.empty_volume(RESOLUTION)
    volume = stored(session.layout, distances, weights)
    marks = np.zeros((BLOCKS,) * 3, np.int32)
    for seed in (0, 1):
        depth = room_depth(camera, seed)
        distances, weights = reference.integrate(
            distances, weights, VOXEL, depth.astype(float), camera, pose, MU, 100
        )
        state = state_of(pose, tracked=1)
        integrate(launch, session, volume, marks, depth, camera, state, conditional=seed)
    got_distances, got_weights = loaded(session.layout, volume)
    differing = (abs(got_distances - distances) > 2e-4) | (got_weights != weights)
    assert (weights == 2).sum() > 500
    assert differing.mean() < 2e-3  # a voxel's centre may fall on the other side of a pixel's border
    # Every copy of a neighbour is up to date.
    expected = stored(session.layout, got_distances, got_weights)
    np.testing.assert_array_equal(volume["voxels"], expected["voxels"])
    expected_marks = marks_of(np.where(weights > 0, distances, 1.0))
    assert ((marks > 0) != (expected_marks > 0)).mean() < 0.02
    searched = np.zeros_like(marks)
    dilate(launch, session, marks, searched, state_of(pose), conditional=0)
    if not session.layout.pixels:
        cells = reference.searched_blocks(got_distances < 0.8, BLOCK)
        assert not (cells & (searched <= 0)).any()
        assert ((searched > 0) != cells).mean() < 0.02


@pytest.mark.parametrize("twist", [(0, 0, 0), (0.3, -0.4, 0.2)], ids=["straight", "askew"])
def test_integrate_leaves_out_what_is_hidden_and_nothing_else(launch, session, twist):
    if session.layout.pixels:
        pytest.skip("by pixels no block is left out")
    depth = room_depth(CAMERA)
    depth[8:, : CAMERA.width // 2] = 0.6  # a near thing, much of the room behind it
    tiles, results = reference.farthest_of_tiles(depth, TILE), []
    for seen in (tiles, np.full_like(tiles, 9.0)):  # with the latter no block counts as hidden
        volume = stored(session.layout, *reference.empty_volume(RESOLUTION))
        marks = np.zeros((BLOCKS,) * 3, np.int32)
        state = state_of(pose_at((1.2, 1.1, 0.15), twist))
        integrate(launch, session, volume, marks, depth, CAMERA, state, tiles=seen)
        results.append((volume, marks))
    (volume, marks), (everything, all_marks) = results
    assert (everything["weights"] > 0).sum() > 500
    np.testing.assert_array_equal(volume["voxels"], everything["voxels"])
    np.testing.assert_array_equal(volume["weights"], everything["weights"])
    np.testing.assert_array_equal(marks, all_marks)
    volume = stored(session.layout, *reference.empty_volume(RESOLUTION))
    state = state_of(pose_at((1.2, 1.1, 0.15), twist))
    integrate(launch, session, volume, marks, depth, CAMERA, state, tiles=np.zeros_like(tiles))
    assert (volume["weights"] > 0).sum() < (everything["weights"] > 0).sum() / 2  # tiles do decide


def test_integrate_stops_at_the_largest_weight(launch, session):
    distances, weights = reference.empty_volume(RESOLUTION)
    volume = stored(session.layout, distances, weights + 3)
    marks = np.zeros((BLOCKS,) * 3, np.int32)
    state = state_of(pose_at((1.2, 1.1, 0.15)))
    integrate(launch, session, volume, marks, room_depth(CAMERA), CAMERA, state, max_weight=3.0)
    got_distances, got_weights = loaded(session.layout, volume)
    assert got_weights.max() == 3
    assert (got_distances < 1).any()


def test_a_lost_frame_changes_no_voxel_and_no_mark(launch, session):
    volume = stored(session.layout, *reference.empty_volume(RESOLUTION))
    before = volume["voxels"].copy()
    marks, searched = np.zeros((BLOCKS,) * 3, np.int32), np.zeros((BLOCKS,) * 3, np.int32)
    state = state_of(pose_at((1.2, 1.1, 0.15)), tracked=0)
    integrate(launch, session, volume, marks, room_depth(CAMERA), CAMERA, state, conditional=1)
    np.testing.assert_array_equal(volume["voxels"], before)
    assert not marks.any()
    dilate(launch, session, np.ones_like(marks), searched, state, conditional=1)
    assert not searched.any()


def dilate(launch, session, marks, searched, state, conditional) -> None:
    launch(
        "dilate_blocks", session.layout.blocks(BLOCKS), surface=marks, searched=searched, blocks=BLOCKS,
        conditional=conditional, state=state,
    )  # fmt: skip


@pytest.mark.parametrize("conditional", [0, 1])
def test_dilate_blocks(launch, session, conditional):
    marks = (np.random.default_rng(6).random((BLOCKS,) * 3) < 0.1).astype(np.int32)
    everywhere = marks if session.layout.pixels else 255 * marks  # in all first layers
    searched = np.zeros_like(marks)
    state = state_of(np.eye(4), tracked=conditional)
    dilate(launch, session, everywhere, searched, state, conditional)
    expected = reference.dilate_blocks(marks > 0)
    if session.layout.pixels:
        np.testing.assert_array_equal(searched > 0, expected)
    else:
        np.testing.assert_array_equal(searched, 1 - reference.chessboard_distances(expected))


def test_a_mark_inside_a_block_needs_no_neighbour(launch, session):
    if session.layout.pixels:
        pytest.skip("by pixels a mark does not say where in the block it is")
    marks, searched = np.zeros((2, BLOCKS, BLOCKS, BLOCKS), np.int32)
    marks[2, 2, 2], marks[0, 3, 1] = 1, 1 | 2 | 4 | 8  # inside, and at the first layers along x and y
    dilate(launch, session, marks, searched, state_of(np.eye(4)), 0)
    blocks = {tuple(block) for block in np.argwhere(searched > 0).tolist()}
    assert blocks == {(2, 2, 2), (0, 3, 1), (0, 3, 0), (0, 2, 1), (0, 2, 0)}


@functools.cache
def raycast_case(mu: float, twist: tuple[float, float, float]) -> tuple:
    """A camera, what it looks into, its pose, and what the reference sees: computed once for all devices."""
    camera = Camera(30.0, 31.0, 19.3, 14.6, 37, 30)
    distances, weights = reference.empty_volume(RESOLUTION)
    distances, weights = reference.integrate(
        distances, weights, VOXEL, room_depth(CAMERA).astype(float), CAMERA, pose_at((1.2, 1.1, 0.1)), mu, 100
    )
    distances = quantised(distances)
    pose = pose_at((1.15, 1.12, 0.12), twist)
    expected = reference.raycast(distances, VOXEL, pose, camera, 0.4, 4.0, VOXEL, 0.75 * mu)
    return camera, distances, weights, pose, expected


def raycast(launch, session, distances, weights, searched, camera, pose, mu) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and normals, (height, width, 3)."""
    vertices, normals = (np.full((3, camera.height, camera.width), 7, np.float32) for _ in range(2))
    launch(
        "raycast", session.layout.over(camera.width, camera.height),
        voxels=stored(session.layout, distances, weights)["voxels"], resolution=RESOLUTION, voxel_size=VOXEL,
        searched=searched, blocks=BLOCKS, width=camera.width, height=camera.height, camera=camera_of(camera),
        near_plane=0.4, far_plane=4.0, small_step=VOXEL, large_step=0.75 * mu, near_surface=NEAR_SURFACE,
        state=state_of(pose), vertices=vertices, normals=normals,
    )  # fmt: skip
    return np.moveaxis(vertices, 0, -1), np.moveaxis(normals, 0, -1)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.08, 0.25, 0.6], ids=["thin", "usual", "thick"])
@pytest.mark.parametrize("twist", [(0, 0, 0), (0.25, -0.3, 0.1)], ids=["straight", "askew"])
def test_raycast(launch, session, mu, twist):
    """Also with truncation bands thinner than a voxel and wider than the scene."""
    camera, distances, weights, pose, (expected_vertices, expected_normals) = raycast_case(mu, twist)
    searched = reference.dilate_blocks(marks_of(distances) > 0).astype(np.int32)
    vertices, normals = raycast(launch, session, distances, weights, searched, camera, pose, mu)
    hit, expected = normals.any(axis=-1), expected_normals.any(axis=-1)
    assert expected.sum() > 200
    assert (hit != expected).mean() < 0.01
    both = hit & expected
    distance = np.linalg.norm(vertices - expected_vertices, axis=-1)[both]
    agreement = np.sum(normals * expected_normals, axis=-1)[both]
    assert np.median(distance) < 1e-5
    assert (distance > 1e-3).mean() < 0.01
    assert (agreement < 0.999).mean() < 0.01
    assert not vertices[~hit].any()


def test_raycast_sees_nothing_in_an_empty_volume_or_from_outside_it(launch, session):
    searched = np.zeros((BLOCKS,) * 3, np.int32)
    for pose in (pose_at((1.2, 1.1, 0.1)), pose_at((9.0, 9.0, 9.0))):
        maps = raycast(launch, session, *reference.empty_volume(RESOLUTION), searched, CAMERA, pose, MU)
        assert not np.dstack(maps).any()
