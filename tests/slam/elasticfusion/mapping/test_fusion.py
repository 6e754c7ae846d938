"""Fusing: every kernel as its reference, and a map that grows frame by frame."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest

from slam.dense.images import intrinsics
from slam.elasticfusion.mapping import fusion
from slam.elasticfusion.mapping.fusion import SOURCE
from slam.elasticfusion.mapping.surfels import SURFEL, MapFullError
from tests.slam.elasticfusion.maps import (
    CAMERA,
    START,
    THRESHOLD,
    Bench,
    assert_same_maps,
    columns_of,
    first_map,
    frame_of,
    index_of,
    planes,
    scene,
)
from tests.slam.numpy_kernels import fusion as reference
from tests.slam.numpy_kernels.dense import exponential


@functools.cache
def second_frame() -> tuple[SimpleNamespace, np.ndarray, np.ndarray, np.ndarray]:
    """A frame from a pose nearby, before a map of which parts have moved away, gone coarse or fine."""
    random = np.random.default_rng(5)
    surfels = first_map()
    surfels["position"] += random.normal(0, 0.003, surfels["position"].shape)
    away = (random.random(len(surfels)) < 0.2) | (np.arange(len(surfels)) % 300 < 100)
    surfels["position"][away] += np.array([0.0, 0.0, 0.3])
    surfels["radius"] *= random.choice([0.5, 1.0, 2.0], len(surfels))
    surfels["confidence"] *= random.choice([1.0, 12.0], len(surfels))
    pose = START @ exponential(np.array([0.004, -0.003, 0.002, 0.01, 0.005, -0.01]))
    return scene(1), surfels, index_of(surfels, pose), pose


def associate(launch, live, surfels, ids, pose, tick) -> np.ndarray:
    cells = (-(-CAMERA.width // 2), -(-CAMERA.height // 2))
    matches, columns = np.full(cells[::-1], 7, np.int32), columns_of(surfels)
    launch(
        SOURCE, "associate", ("image", *cells), live.raw.astype(np.float32), *planes(live.normals),
        CAMERA.width, CAMERA.height, intrinsics(CAMERA), ids.astype(np.int32), columns["position_confidence"],
        columns["normal_radius"], frame_of(pose, tick), fusion.ASSOCIATION_DISTANCE,
        fusion.ASSOCIATION_NORMAL, fusion.SLANTED, matches,
    )  # fmt: skip
    return matches


@functools.cache
def expected_matches(tick: int) -> np.ndarray:
    live, surfels, ids, pose = second_frame()
    return reference.associate(live.raw, live.normals, CAMERA, ids, surfels, pose, tick % 2)


@pytest.mark.slow
@pytest.mark.parametrize("tick", [2, 3])
def test_associate(launch, tick):
    live, surfels, ids, pose = second_frame()
    matches = associate(launch, live, surfels, ids, pose, tick)
    expected = expected_matches(tick)
    assert (expected >= 0).sum() > 80
    assert (expected == reference.NEW).sum() > 10
    assert (expected == reference.NOTHING).sum() > 20
    assert (matches != expected).mean() < 0.01  # two may be equally near up to rounding


@pytest.mark.parametrize("tick", [2, 3])
def test_update(launch, tick):
    """Also where several pixels match one surfel: the first of them counts."""
    live, surfels, ids, pose = second_frame()
    matches = expected_matches(tick).copy()
    shared = np.argwhere((matches[:, 1:] >= 0) & (matches[:, :-1] >= 0))[::5]
    for row, column in shared:
        matches[row, column + 1] = matches[row, column]
    below = np.argwhere((matches[1:, :-1] >= 0) & (matches[:-1, 1:] >= 0))[1::7]
    for row, column in below:
        matches[row + 1, column] = matches[row, column + 1]
    expected = reference.update(
        live.raw, live.filtered, live.normals, live.colour, CAMERA, ids, matches, surfels, pose, 0.7, tick
    )
    columns = columns_of(surfels)
    share_x, share_y = fusion.shares(CAMERA)
    launch(
        SOURCE, "update", ("image", *matches.shape[::-1]), live.raw.astype(np.float32),
        live.filtered.astype(np.float32), *planes(live.normals), live.colour, CAMERA.width, CAMERA.height,
        intrinsics(CAMERA), share_x, share_y, ids.astype(np.int32), frame_of(pose, tick, 0.7),
        fusion.MOST_COARSENING, matches.astype(np.int32), columns["position_confidence"],
        columns["normal_radius"], columns["colour"], columns["last_seen"],
    )  # fmt: skip
    confirmed = (expected["last_seen"] == tick) & (expected["radius"] == surfels["radius"])
    assert confirmed.sum() > 10
    assert (expected["radius"] != surfels["radius"]).sum() > 40
    assert_same_maps(columns, expected)


@pytest.mark.parametrize(("step", "tick"), [(1, 1), (2, 2), (2, 3)])
def test_append(launch, step, tick):
    live, surfels, ids, pose = second_frame()
    if step == 1:
        matches = np.full((CAMERA.height, CAMERA.width), 7, np.int32)
        launch(
            SOURCE, "all_new", ("image", *matches.shape[::-1]), live.raw.astype(np.float32),
            *planes(live.normals), CAMERA.width, CAMERA.height, matches,
        )  # fmt: skip
        np.testing.assert_array_equal(matches, reference.all_new(live.raw, live.normals))
    else:
        matches = expected_matches(tick).astype(np.int32)
    rows, columns = matches.shape
    row_new, total = np.zeros(rows, np.int32), np.zeros(1, np.int32)
    launch(SOURCE, "count_new", (rows,), matches, columns, row_new)
    np.testing.assert_array_equal(row_new, reference.count_new(matches))
    before, new = reference.scan_rows(reference.count_new(matches))
    launch(SOURCE, "scan_rows", (1,), row_new, rows, total)
    np.testing.assert_array_equal(row_new, before)
    assert total[0] == new > 10

    expected, expected_ids = reference.append(
        live.raw, live.filtered, live.normals, live.colour, CAMERA, ids, matches, surfels, pose, 0.6, tick,
        step, tick % step,
    )  # fmt: skip
    arrays = columns_of(np.concatenate([surfels, np.zeros(new, SURFEL)]))
    got_ids, (share_x, share_y) = ids.astype(np.int32), fusion.shares(CAMERA)
    launch(
        SOURCE, "append", (rows,), live.raw.astype(np.float32), live.filtered.astype(np.float32),
        *planes(live.normals), live.colour, CAMERA.width, intrinsics(CAMERA), share_x, share_y,
        frame_of(pose, tick, 0.6, step, len(surfels)), matches, row_new, got_ids,
        arrays["position_confidence"], arrays["normal_radius"], arrays["colour"], arrays["first_seen"],
        arrays["last_seen"],
    )  # fmt: skip
    assert_same_maps(arrays, expected)
    np.testing.assert_array_equal(got_ids, expected_ids)


def test_a_camera_at_rest_makes_the_same_surfels_stable(session):
    """No surfel is doubled, what is measured gains confidence, and the rest is gone after a while."""
    bench = Bench(session)
    live = scene(0)
    bench.see(live, START)
    first = bench.fusion.initialise(START, 1)
    assert_same_maps(columns_of(bench.surfels.read()), first_map())
    for tick in range(2, 26):
        bench.see(live, START)
        assert bench.fusion.fuse(START, tick, 1.0) == 0
        bench.fusion.clean(START, tick)
    surfels = bench.surfels.read()
    assert (surfels["confidence"] >= THRESHOLD).sum() > first / 3
    unstable = surfels[surfels["confidence"] < THRESHOLD]
    assert (unstable["last_seen"] >= 25 - fusion.UNSTABLE_FRAMES).all()
    assert len(surfels) < first
    assert (np.diff(surfels["first_seen"]) >= 0).all()


def test_what_the_camera_sees_anew_is_appended_and_shown(session):
    bench = Bench(session)
    bench.see(scene(0), START)
    first = bench.fusion.initialise(START, 1)
    moved = START @ exponential(np.array([0, 0, 0, 0, 0.3, 0]))
    bench.see(scene(0), moved)
    new = bench.fusion.fuse(moved, 2, 0.5)
    assert bench.surfels.count == first + new > first
    surfels, shown = bench.surfels.read(), bench.indexed()
    shown = shown[shown >= first]
    assert len(shown) > new / 2
    assert len(np.unique(shown)) == len(shown)
    assert (surfels["first_seen"][shown] == 2).all()


def test_a_map_that_is_full_says_so_and_loses_nothing(session):
    bench = Bench(session, capacity=100)
    bench.see(scene(0), START)
    with pytest.raises(MapFullError, match=r"surfel_capacity=100: raise it"):
        bench.fusion.initialise(START, 1)
    assert bench.surfels.count == 0
