"""Fusing, cleaning, compacting and deforming: every kernel as its reference, and a map as a whole."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest

from slam.camera import Camera
from slam.dense.images import Planes, intrinsics
from slam.dense.reference import exponential, normal_map
from slam.elasticfusion import fusion
from slam.elasticfusion import reference_fusion as reference
from slam.elasticfusion.compaction import Compaction
from slam.elasticfusion.deforming import Deforming
from slam.elasticfusion.fusion import CLEANING, FRAME, SOURCE, Fusion
from slam.elasticfusion.graph import Deformation, Graph
from slam.elasticfusion.surfels import RUN, SURFEL, MapFullError, Surfels

CAMERA = Camera(30.0, 31.0, 19.3, 14.6, 37, 29)
START = exponential(np.array([0.3, -0.2, 0.1, 0.2, -0.3, 0.1]))
THRESHOLD = 2.0


@functools.cache
def scene(seed: int, box: bool = True) -> SimpleNamespace:
    """A wavy wall with a box before it, noise and holes: raw and filtered depth, normals and colours."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    filtered = 1.2 + 0.05 * np.sin(x / 4.0) + 0.4 * (y / CAMERA.height)
    if box:
        filtered[8:20, 10:22] = 0.9
    raw = filtered + random.normal(0, 0.002, filtered.shape)
    raw[random.random(raw.shape) < 0.04] = 0
    colour = random.integers(1, 1 << 24, raw.shape).astype(np.uint32)
    colour[random.random(raw.shape) < 0.1] = 0
    return SimpleNamespace(
        raw=raw.astype(np.float32).astype(float),
        filtered=filtered.astype(np.float32).astype(float),
        normals=normal_map(filtered, CAMERA),
        colour=colour,
    )


def first_map() -> np.ndarray:
    return made_of_the_first_frame().copy()


@functools.cache
def made_of_the_first_frame() -> np.ndarray:
    """The map that the reference makes of it."""
    live = scene(0)
    matches = reference.all_new(live.raw, live.normals)
    surfels, _ = reference.append(
        live.raw, live.filtered, live.normals, live.colour, CAMERA, empty_index(), matches,
        np.zeros(0, SURFEL), START, 1.0, 1, 1, 0,
    )  # fmt: skip
    return surfels


def empty_index() -> np.ndarray:
    return np.full((CAMERA.height, CAMERA.width), -1)


def index_of(surfels: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The nearest surfel of each pixel."""
    ids, depths = empty_index(), np.full((CAMERA.height, CAMERA.width), np.inf)
    points = (surfels["position"] - pose[:3, 3]) @ pose[:3, :3]
    u = np.floor(CAMERA.fx * points[:, 0] / points[:, 2] + CAMERA.cx + 0.5).astype(int)
    v = np.floor(CAMERA.fy * points[:, 1] / points[:, 2] + CAMERA.cy + 0.5).astype(int)
    inside = (u >= 0) & (u < CAMERA.width) & (v >= 0) & (v < CAMERA.height) & (surfels["confidence"] > 0)
    for i in np.flatnonzero(inside & (points[:, 2] > 0)):
        if points[i, 2] < depths[v[i], u[i]]:
            ids[v[i], u[i]], depths[v[i], u[i]] = i, points[i, 2]
    return ids


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


def planes(normals: np.ndarray) -> list[np.ndarray]:
    return [np.ascontiguousarray(normals[..., axis], np.float32) for axis in range(3)]


def frame_of(pose: np.ndarray, tick: int, weight: float = 1.0, step: int = 2, count: int = 0) -> np.ndarray:
    frame = np.zeros(1, FRAME)
    frame["pose"], frame["weight"], frame["tick"] = pose[:3].ravel(), weight, tick
    frame["step"], frame["phase"], frame["count"] = step, tick % step, count
    return frame


def columns_of(surfels: np.ndarray) -> dict[str, np.ndarray]:
    """A map as the device holds it."""
    return {
        "place": np.column_stack([surfels["position"], surfels["confidence"]]),
        "face": np.column_stack([surfels["normal"], surfels["radius"]]),
        "colour": surfels["colour"].copy(),
        "born": surfels["born"].copy(),
        "seen": surfels["seen"].copy(),
    }


def assert_same_maps(columns: dict[str, np.ndarray], expected: np.ndarray) -> None:
    for name, column in columns_of(expected).items():
        if name == "colour":
            for shift in (0, 8, 16):
                got, wanted = (values >> shift & 0xFF for values in (columns[name], column))
                assert abs(got.astype(int) - wanted.astype(int)).max() <= 1
        else:
            np.testing.assert_allclose(columns[name], column, rtol=2e-5, atol=2e-5, err_msg=name)


def associate(launch, live, surfels, ids, pose, tick) -> np.ndarray:
    cells = (-(-CAMERA.width // 2), -(-CAMERA.height // 2))
    matches, columns = np.full(cells[::-1], 7, np.int32), columns_of(surfels)
    launch(
        SOURCE, "associate", ("image", *cells), live.raw.astype(np.float32), *planes(live.normals),
        CAMERA.width, CAMERA.height, intrinsics(CAMERA), ids.astype(np.int32), columns["place"],
        columns["face"], frame_of(pose, tick), fusion.ASSOCIATION_DISTANCE, fusion.ASSOCIATION_NORMAL,
        fusion.SLANTED, matches,
    )  # fmt: skip
    return matches


@functools.cache
def expected_matches(tick: int) -> np.ndarray:
    live, surfels, ids, pose = second_frame()
    return reference.associate(live.raw, live.normals, CAMERA, ids, surfels, pose, tick % 2)


@pytest.mark.parametrize("tick", [2, 3])
def test_associate(launch, tick):
    live, surfels, ids, pose = second_frame()
    matches = associate(launch, live, surfels, ids, pose, tick)
    expected = expected_matches(tick)
    assert (expected >= 0).sum() > 80
    assert (expected == reference.NEW).sum() > 10
    assert (expected == reference.NOTHING).sum() > 20
    assert (matches != expected).mean() < 0.01  # two may be equally near but for rounding


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
        fusion.MOST_COARSENING, matches.astype(np.int32), columns["place"], columns["face"],
        columns["colour"], columns["seen"],
    )  # fmt: skip
    confirmed = (expected["seen"] == tick) & (expected["radius"] == surfels["radius"])
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
        frame_of(pose, tick, 0.6, step, len(surfels)), matches, row_new, got_ids, arrays["place"],
        arrays["face"], arrays["colour"], arrays["born"], arrays["seen"],
    )  # fmt: skip
    assert_same_maps(arrays, expected)
    np.testing.assert_array_equal(got_ids, expected_ids)


@functools.cache
def layered_map() -> tuple[np.ndarray, np.ndarray]:
    """An old stable wall with younger surfels just before it and far before it."""
    random = np.random.default_rng(8)
    wall = first_map()
    wall["confidence"] = random.choice([0.5, 5.0, 5.0, 5.0], len(wall))
    wall["seen"] = random.choice([30, 40, 40], len(wall))
    front = wall[random.random(len(wall)) < 0.25].copy()
    depth = random.choice([0.004, 0.1], len(front))
    towards = START[:3, 3] - front["position"]
    front["position"] += towards * (depth / np.linalg.norm(towards, axis=1))[:, None]
    front["born"], front["seen"] = random.choice([1, 20], len(front)), random.choice([30, 40], len(front))
    front["confidence"] = random.choice([0.5, 5.0], len(front))
    surfels = np.concatenate([wall, front[np.argsort(front["born"], kind="stable")]])
    return surfels, index_of(surfels, START)


@functools.cache
def expected_verdict() -> np.ndarray:
    surfels, ids = layered_map()
    return reference.judge(scene(0).raw, ids, surfels, START, 40, THRESHOLD)


def test_judge_and_remove_condemned(launch):
    surfels, ids = layered_map()
    raw, expected = scene(0).raw, expected_verdict()
    columns, size = columns_of(surfels), (CAMERA.width, CAMERA.height)
    condemned, removed = np.full(ids.shape, 7, np.uint8), np.zeros(1, np.int32)
    launch(
        CLEANING, "judge", ("image", *size), raw.astype(np.float32), *size, ids.astype(np.int32),
        columns["place"], columns["face"], columns["born"], columns["seen"], frame_of(START, 40), THRESHOLD,
        fusion.DOUBLE_DISTANCE, fusion.DOUBLE_REACH, fusion.DOUBLES, fusion.ASSOCIATION_DISTANCE,
        fusion.SEEN_THROUGH, condemned,
    )  # fmt: skip
    gone = surfels[ids[expected]]
    assert (gone["born"] == 20).sum() > 10
    assert (gone["born"] == 1).sum() > 10  # seen through, thus never just a double
    np.testing.assert_array_equal(condemned, expected)
    launch(
        CLEANING, "remove_condemned", ("image", *size), *size, ids.astype(np.int32), condemned,
        columns["place"], removed,
    )  # fmt: skip
    left, count = reference.remove_condemned(ids, expected, surfels)
    np.testing.assert_array_equal(columns["place"], columns_of(left)["place"])
    assert removed[0] == count


def written(session, surfels: np.ndarray) -> Surfels:
    on_device = Surfels(session, len(surfels) + 10)
    on_device.write(surfels)
    return on_device


def many_surfels(count: int = 5 * RUN + 77) -> np.ndarray:
    """Surfels of a room, born over 60 ticks, a third of them removed."""
    random = np.random.default_rng(9)
    surfels = np.zeros(count, SURFEL)
    surfels["position"] = random.uniform(-2, 2, (count, 3))
    normals = random.normal(size=(count, 3))
    surfels["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    surfels["radius"], surfels["colour"] = 0.01, random.integers(0, 1 << 24, count)
    surfels["confidence"] = random.choice([0.0, 1.0, 4.0], count)
    surfels["born"] = np.sort(random.integers(1, 60, count))
    surfels["seen"] = surfels["born"] + random.integers(0, 30, count)
    return surfels


def test_remove_unstable(session):
    import pyopencl as cl

    surfels = many_surfels()
    on_device, removed = written(session, surfels), session.buffer(4)
    cl.enqueue_copy(session.queue, removed, np.zeros(1, np.int32))
    arguments = (on_device.seen, 12, 40, THRESHOLD, on_device.place, removed)
    on_device.kernel(CLEANING, "remove_unstable", *arguments)()
    expected, count = reference.remove_unstable(surfels, 12, 40, THRESHOLD)
    np.testing.assert_array_equal(on_device.read(removed=True), expected)
    total = np.empty(1, np.int32)
    cl.enqueue_copy(session.queue, total, removed)
    assert total[0] == count > 100


@pytest.mark.parametrize("living", ["some", "none", "all", "ends"])
def test_compaction_keeps_the_living_in_their_order(session, living, monkeypatch):
    monkeypatch.setattr("slam.elasticfusion.compaction.STRETCH", 2)
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


def bent_graph(nodes: Graph) -> Deformation:
    """Each node turned and moved a little, and not quite rigidly."""
    random = np.random.default_rng(10)
    turns = [exponential(np.array([0, 0, 0, *random.normal(0, 0.1, 3)]))[:3, :3] for _ in range(len(nodes))]
    rotations = np.array(turns) + random.normal(0, 0.02, (len(nodes), 3, 3))
    return Deformation(nodes, rotations, random.normal(0, 0.05, (len(nodes), 3)))


@pytest.mark.parametrize("every", [90, 1100])
def test_sample_and_deform(session, every):
    """With nodes by the dozen and with just enough of them."""
    surfels = many_surfels()
    surfels["confidence"][90:270] = 0  # no node from here
    on_device = written(session, surfels)
    deforming = Deforming(session, on_device)
    nodes, expected_nodes = deforming.sample(every), reference.sample_nodes(surfels, every)
    np.testing.assert_array_equal(nodes.positions, expected_nodes["position"])
    np.testing.assert_array_equal(nodes.times, expected_nodes["born"])
    assert nodes.usable

    deformation = bent_graph(nodes)
    deforming.deform(deformation, 60)
    expected, got = reference.deform(surfels, deformation), on_device.read(removed=True)
    np.testing.assert_allclose(got["position"], expected["position"], atol=2e-5)
    np.testing.assert_allclose(got["normal"], expected["normal"], atol=2e-5)
    for name in ("confidence", "radius", "colour", "born", "seen"):
        np.testing.assert_array_equal(got[name], expected[name])


def test_an_empty_map_has_no_nodes(session):
    assert len(Deforming(session, Surfels(session, 10)).sample(5)) == 0


def test_reactivate(session):
    surfels = first_map()
    random = np.random.default_rng(11)
    surfels["confidence"] = random.choice([0.0, 1.0, 5.0], len(surfels))
    surfels["position"] += random.choice([-0.3, 0.0, 0.3], len(surfels))[:, None] * START[:3, 2]
    surface = scene(0).raw
    on_device, depth = written(session, surfels), uploaded(session, surface.astype(np.float32))
    image = SimpleNamespace(camera=CAMERA, depth=depth)
    Deforming(session, on_device).reactivate(image, START, 77, THRESHOLD)
    expected = reference.reactivate(surfels, surface, CAMERA, START, 77, THRESHOLD)
    assert 50 < (expected["seen"] == 77).sum() < (surfels["confidence"] == 5).sum() - 50
    assert (on_device.read(removed=True)["seen"] != expected["seen"]).mean() < 0.01


def uploaded(session, values: np.ndarray):
    import pyopencl as cl

    buffer = session.buffer(values.nbytes)
    cl.enqueue_copy(session.queue, buffer, np.ascontiguousarray(values))
    return buffer


class Bench:
    """A map with its fusion, whose live frame and index map are set by hand."""

    def __init__(self, session, capacity: int = 5000) -> None:
        pixels = CAMERA.width * CAMERA.height
        self.session = session
        self.surfels = Surfels(session, capacity)
        self.ids = session.buffer(4 * pixels)
        image = SimpleNamespace(
            camera=CAMERA,
            depth=session.buffer(4 * pixels),
            normals=Planes.allocate(session, pixels),
            colour=session.buffer(4 * pixels),
        )
        self.live = SimpleNamespace(filtered=session.buffer(4 * pixels), image=image)
        index_map = SimpleNamespace(ids=self.ids)
        self.fusion = Fusion(session, self.surfels, index_map, self.live, THRESHOLD)

    def see(self, live: SimpleNamespace, pose: np.ndarray) -> None:
        """Upload a frame, and the index map of what the map holds."""
        import pyopencl as cl

        image, queue = self.live.image, self.session.queue
        cl.enqueue_copy(queue, image.depth, live.raw.astype(np.float32))
        cl.enqueue_copy(queue, self.live.filtered, live.filtered.astype(np.float32))
        for place, plane in zip(image.normals, planes(live.normals), strict=True):
            cl.enqueue_copy(queue, place, plane)
        cl.enqueue_copy(queue, image.colour, live.colour)
        cl.enqueue_copy(queue, self.ids, index_of(self.surfels.read(removed=True), pose).astype(np.int32))

    def indexed(self) -> np.ndarray:
        import pyopencl as cl

        ids = np.empty((CAMERA.height, CAMERA.width), np.int32)
        cl.enqueue_copy(self.session.queue, ids, self.ids)
        return ids


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
    assert (unstable["seen"] >= 25 - fusion.UNSTABLE_FRAMES).all()
    assert len(surfels) < first
    assert (np.diff(surfels["born"]) >= 0).all()


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
    assert (surfels["born"][shown] == 2).all()


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


def test_a_map_that_is_full_says_so_and_loses_nothing(session):
    bench = Bench(session, capacity=100)
    bench.see(scene(0), START)
    with pytest.raises(MapFullError, match=r"surfel_capacity=100: raise it"):
        bench.fusion.initialise(START, 1)
    assert bench.surfels.count == 0


def test_a_crowded_map_gives_up_the_places_of_removed_surfels(session):
    cells = -(-CAMERA.width // 2) * -(-CAMERA.height // 2)
    surfels = many_surfels(2000)
    surfels["confidence"], surfels["seen"] = 1.0, 30  # unstable, and unseen for 25 frames
    surfels["confidence"][::20] = 9.0
    bench = Bench(session, capacity=len(surfels) + cells - 1)
    bench.surfels.write(surfels)
    dark = SimpleNamespace(**(vars(scene(0)) | {"raw": np.zeros((CAMERA.height, CAMERA.width))}))
    bench.see(dark, START)
    for tick in (55, 56):
        assert bench.fusion.fuse(START, tick, 1.0) == 0
        bench.fusion.clean(START, tick)
    np.testing.assert_array_equal(bench.surfels.read(removed=True), surfels[::20])
