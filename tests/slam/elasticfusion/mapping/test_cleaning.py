"""Removing surfels and compacting the map: every kernel as its reference, and what leaves a map."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest

from slam.elasticfusion.mapping import fusion
from slam.elasticfusion.mapping.compaction import Compaction
from slam.elasticfusion.mapping.fusion import CLEANING
from slam.elasticfusion.mapping.surfels import RUN
from tests.slam.elasticfusion.maps import (
    CAMERA,
    START,
    THRESHOLD,
    Bench,
    columns_of,
    first_map,
    frame_of,
    index_of,
    many_surfels,
    scene,
    written,
)
from tests.slam.numpy_kernels import fusion as reference


@functools.cache
def layered_map() -> tuple[np.ndarray, np.ndarray]:
    """An old stable wall with younger surfels just before it and far before it."""
    random = np.random.default_rng(8)
    wall = first_map()
    wall["confidence"] = random.choice([0.5, 5.0, 5.0, 5.0], len(wall))
    wall["last_seen"] = random.choice([30, 40, 40], len(wall))
    front = wall[random.random(len(wall)) < 0.25].copy()
    depth = random.choice([0.004, 0.1], len(front))
    towards = START[:3, 3] - front["position"]
    front["position"] += towards * (depth / np.linalg.norm(towards, axis=1))[:, None]
    front["first_seen"], front["last_seen"] = (
        random.choice([1, 20], len(front)),
        random.choice([30, 40], len(front)),
    )
    front["confidence"] = random.choice([0.5, 5.0], len(front))
    surfels = np.concatenate([wall, front[np.argsort(front["first_seen"], kind="stable")]])
    return surfels, index_of(surfels, START)


@functools.cache
def expected_verdict() -> np.ndarray:
    surfels, ids = layered_map()
    return reference.mark_for_removal(scene(0).raw, ids, surfels, START, 40, THRESHOLD)


@pytest.mark.slow
def test_mark_for_removal_and_remove_marked(launch):
    surfels, ids = layered_map()
    raw, expected = scene(0).raw, expected_verdict()
    columns, size = columns_of(surfels), (CAMERA.width, CAMERA.height)
    marked, removed = np.full(ids.shape, 7, np.uint8), np.zeros(1, np.int32)
    launch(
        CLEANING, "mark_for_removal", ("image", *size), raw.astype(np.float32), *size, ids.astype(np.int32),
        columns["position_confidence"], columns["normal_radius"], columns["first_seen"],
        columns["last_seen"], frame_of(START, 40), THRESHOLD, fusion.DOUBLE_DISTANCE, fusion.DOUBLE_REACH,
        fusion.DOUBLES, fusion.ASSOCIATION_DISTANCE, fusion.SEEN_THROUGH, marked,
    )  # fmt: skip
    gone = surfels[ids[expected]]
    assert (gone["first_seen"] == 20).sum() > 10
    assert (gone["first_seen"] == 1).sum() > 10  # seen through, thus never just a double
    np.testing.assert_array_equal(marked, expected)
    launch(
        CLEANING, "remove_marked", ("image", *size), *size, ids.astype(np.int32), marked,
        columns["position_confidence"], removed,
    )  # fmt: skip
    left, count = reference.remove_marked(ids, expected, surfels)
    np.testing.assert_array_equal(columns["position_confidence"], columns_of(left)["position_confidence"])
    assert removed[0] == count


def test_remove_unstable(session):
    surfels = many_surfels()
    on_device, removed = written(session, surfels), session.buffer(4)
    session.upload(removed, np.zeros(1, np.int32))
    arguments = (on_device.last_seen, 12, 40, THRESHOLD, on_device.position_confidence, removed)
    on_device.kernel(CLEANING, "remove_unstable", *arguments)()
    expected, count = reference.remove_unstable(surfels, 12, 40, THRESHOLD)
    np.testing.assert_array_equal(on_device.read(removed=True), expected)
    total = np.empty(1, np.int32)
    session.download(removed, total)
    assert total[0] == count > 100


@pytest.mark.parametrize("living", ["some", "none", "all", "ends"])
def test_compaction_keeps_the_living_in_their_order(session, living, monkeypatch):
    monkeypatch.setattr("slam.elasticfusion.mapping.compaction.STRETCH", 2)
    surfels = many_surfels()
    if living != "some":
        surfels["confidence"] = {"none": 0.0, "all": 1.0, "ends": 0.0}[living]
    if living == "ends":
        surfels["confidence"][[0, -1]] = 1.0
    on_device = written(session, surfels)
    expected = reference.gather_living(surfels)
    assert Compaction(session, on_device).compact() == len(surfels) - len(expected)
    assert on_device.count == len(expected) == reference.count_living(surfels, RUN).sum()
    np.testing.assert_array_equal(on_device.read(removed=True), expected)


@pytest.mark.slow
def test_what_was_taken_away_leaves_the_map(session):
    """And the wall behind it comes into it."""
    bench = Bench(session)
    for tick in range(1, 40):
        live = scene(tick % 2, box=tick < 20)
        bench.see(live, START)
        if tick == 1:
            bench.fusion.initialise(START, 1)
            continue
        bench.fusion.fuse(START, tick, 1.0)
        bench.fusion.clean(START, tick)
        if tick in (19, 39):
            surfels = bench.surfels.read()
            surfels = surfels[surfels["confidence"] >= THRESHOLD]
            depth = ((surfels["position"] - START[:3, 3]) @ START[:3, :3])[:, 2]
            if tick == 19:
                before = depth
    assert (before < 1.0).sum() > 50
    assert (depth < 1.0).sum() < 0.1 * (before < 1.0).sum()
    assert (depth > 1.0).sum() > (before > 1.0).sum()


def test_a_crowded_map_gives_up_the_places_of_removed_surfels(session):
    cells = -(-CAMERA.width // 2) * -(-CAMERA.height // 2)
    surfels = many_surfels(2000)
    surfels["confidence"], surfels["last_seen"] = 1.0, 30  # unstable, and unseen for 25 frames
    surfels["confidence"][::20] = 9.0
    bench = Bench(session, capacity=len(surfels) + cells - 1)
    bench.surfels.write(surfels)
    dark = SimpleNamespace(**(vars(scene(0)) | {"raw": np.zeros((CAMERA.height, CAMERA.width))}))
    bench.see(dark, START)
    for tick in (55, 56):
        assert bench.fusion.fuse(START, tick, 1.0) == 0
        bench.fusion.clean(START, tick)
    np.testing.assert_array_equal(bench.surfels.read(removed=True), surfels[::20])
