"""What a camera sees of the map is what the NumPy references see, on every device present."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from slam.camera import Camera
from slam.elasticfusion.loops import thumbnail
from slam.elasticfusion.loops.thumbnail import Sampling, Thumbnail, sampled
from slam.elasticfusion.mapping.fill_in import FillIn
from slam.elasticfusion.mapping.index_map import IndexMap
from slam.elasticfusion.mapping.prediction import Prediction
from slam.elasticfusion.mapping.surfels import RUN, SURFEL, MapFullError, Surfels
from slam.elasticfusion.mapping.view import View
from slam.elasticfusion.mapping.visible import Visible
from tests.slam.numpy_kernels import dense
from tests.slam.numpy_kernels import prediction as reference

CAMERA = Camera(50.0, 52.0, 23.3, 36.6, 47, 75)
MIRRORED = Camera(50.0, -52.0, 23.3, 36.6, 47, 75)
SEEN, CONFIDENCE = (5, 20), 3.0
SPARE = RUN + 100  # places without visible surfels, before the others: ids span more than one run


def pose_at(position: tuple[float, float, float], twist: tuple[float, float, float]) -> np.ndarray:
    return dense.exponential(np.array([0, 0, 0, *twist], float)) + np.pad(
        np.array(position)[:, None], ((0, 1), (3, 0))
    )


POSE = pose_at((0.3, -0.2, 0.1), (0.1, -0.2, 0.15))


def cluttered_map(seed: int = 0, size: int = 700) -> np.ndarray:
    """Discs in front of the camera at POSE, most of them wanted; colours tell them apart."""
    random = np.random.default_rng(seed)
    surfels = np.zeros(SPARE + size, SURFEL)
    visible = surfels[SPARE:]
    depth = random.uniform(0.5, 3.0, size)
    pixels = random.uniform(-10, 85, (size, 2)) * [CAMERA.width / 75, 1]
    points = np.column_stack(
        [(pixels - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy] * depth[:, None], depth]
    )
    points[:20, 2] *= -1  # behind the camera
    points[20:30] *= 30  # too far away
    normals = random.normal(size=(size, 3)) - points * 2
    normals[30:80] += points[30:80] * 5  # some face away
    points[90:95] = np.column_stack([np.zeros(5), np.linspace(-1, 1, 5), np.full(5, 2.5)])
    normals[90:95] = [0, 0.1, -1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    visible["radius"] = depth / 50 * random.uniform(0.5, 4, size)
    visible["radius"][90:95] = 1.0  # reaches over many bands
    visible["position"] = points @ POSE[:3, :3].T + POSE[:3, 3]
    visible["normal"] = normals @ POSE[:3, :3].T
    visible["confidence"] = random.choice([0, 1, 3, 8], size, p=[0.1, 0.1, 0.4, 0.4])
    surfels["first_seen"] = np.sort(random.integers(1, 9, len(surfels)))
    surfels["last_seen"][SPARE:] = random.integers(4, 23, size)
    visible["confidence"][90:95], visible["last_seen"][90:95] = CONFIDENCE, SEEN[0]
    visible[-40:] = visible[200:240]  # the same once more: the smaller id is seen
    surfels["colour"] = np.arange(len(surfels)) + 1
    return surfels


@functools.cache
def case(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """A map, and the ids of what the reference draws of it: computed once for all devices."""
    surfels = cluttered_map()
    return surfels, reference.splat(surfels, POSE, SEEN, CONFIDENCE, camera)[1]


def on_device(session, surfels: np.ndarray) -> Surfels:
    there = Surfels(session, len(surfels) + 3)
    there.write(surfels)
    return there


def fetched(session, buffer, shape, dtype) -> np.ndarray:
    array = np.empty(shape, dtype)
    session.download(buffer, array)
    return array


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, MIRRORED], ids=["plain", "mirrored"])
def test_a_prediction_shows_the_nearest_disc_at_each_pixel(session, camera):
    surfels, ids = case(camera)
    prediction = Prediction(session, on_device(session, surfels), camera)
    prediction.render(POSE, SEEN, CONFIDENCE)
    image = thumbnail.read(session, prediction.image)
    depth, normals, colour, first_seen, confidence = reference.resolve(ids, surfels, POSE, camera)
    assert 0.3 < (colour > 0).mean() < 0.98
    assert len(np.unique(colour)) > 150
    same = image.colour == colour  # which surfel it is
    assert same.mean() > 0.998
    np.testing.assert_allclose(image.depth[same], depth[same], rtol=1e-5)
    np.testing.assert_allclose(image.normals[same], normals[same], atol=1e-5)
    assert (np.sum(image.normals * image.vertices, axis=-1)[image.colour > 0] < 0).all()
    shape = colour.shape
    np.testing.assert_array_equal(
        fetched(session, prediction.first_seen, shape, np.int32)[same], first_seen[same]
    )
    np.testing.assert_array_equal(
        fetched(session, prediction.confidence, shape, np.float32)[same], confidence[same]
    )
    assert prediction.covered() == reference.covered_of_rows(image.depth).sum() > 0


def test_rims_do_not_stand_out_of_a_curved_surface(session):
    """Discs of a ball overlap widely, and still the prediction is as far away as the ball is."""
    camera = Camera(200.0, 200.0, 31.5, 31.5, 64, 64)
    random = np.random.default_rng(7)
    surfels = np.zeros(6000, SURFEL)
    surfels["normal"] = random.normal(size=(6000, 3))
    surfels["normal"] /= np.linalg.norm(surfels["normal"], axis=1, keepdims=True)
    surfels["position"] = surfels["normal"] * 0.3 + [0, 0, 1.5]
    surfels["confidence"], surfels["radius"], surfels["colour"] = 5, 0.03, 1
    prediction = Prediction(session, on_device(session, surfels), camera)
    prediction.render(np.eye(4), (0, 0), 1)
    points = thumbnail.read(session, prediction.image).vertices[16:48, 16:48].reshape(-1, 3)
    heights = np.linalg.norm(points - [0, 0, 1.5], axis=1) - 0.3  # a rim lies 1.5 mm above the ball
    assert points[:, 2].min() > 0
    assert heights.mean() < 0.0003
    assert heights.min() > -1e-5


def test_a_prediction_follows_the_map_and_the_view(session):
    """Nothing of one rendering is left in the next, whatever happens to the map in between."""
    surfels = cluttered_map()
    there = on_device(session, surfels)
    prediction = Prediction(session, there, CAMERA)
    prediction.render(POSE, SEEN, CONFIDENCE)
    first = thumbnail.read(session, prediction.image)
    prediction.render(POSE, (30, 40), CONFIDENCE)
    assert prediction.covered() == 0
    assert not thumbnail.read(session, prediction.image).normals.any()
    there.write(surfels[:0])
    prediction.render(POSE, SEEN, CONFIDENCE)
    assert prediction.covered() == 0
    there.write(surfels)
    prediction.render(POSE, SEEN, CONFIDENCE)
    np.testing.assert_array_equal(thumbnail.read(session, prediction.image).depth, first.depth)


@pytest.mark.slow
def test_predictions_may_share_what_is_visible(session):
    surfels, ids = case(CAMERA)
    there = on_device(session, surfels)
    visible = Visible(session, there, CAMERA)
    active, old = (Prediction(session, there, CAMERA, visible) for _ in range(2))
    index_map = IndexMap(session, there, CAMERA, visible)
    active.render(POSE, SEEN, CONFIDENCE)
    old.render(POSE, (0, 4), 0.0)
    index_map.build(POSE, SEEN)
    _, _, expected, _, _ = reference.resolve(ids, surfels, POSE, CAMERA)
    assert (thumbnail.read(session, active.image).colour == expected).mean() > 0.998
    assert 0 < old.covered() < active.covered()


@pytest.mark.parametrize("camera", [CAMERA, MIRRORED], ids=["plain", "mirrored"])
def test_an_index_map_holds_the_nearest_surfel_of_each_pixel(session, camera):
    surfels = cluttered_map(seed=1, size=1800)
    surfels["position"][1500:1600] = surfels["position"][1400:1500]  # as near: the smaller id is held
    index_map = IndexMap(session, on_device(session, surfels), camera)
    index_map.build(POSE, SEEN)
    ids = fetched(session, index_map.ids, (camera.height, camera.width), np.int32)
    expected = reference.index_surfels(surfels, POSE, SEEN, 0, camera)
    assert (expected >= 0).sum() > 500
    assert (ids == expected).mean() > 0.998


@pytest.mark.slow
@pytest.mark.parametrize("whole", [True, False], ids=["discs", "points"])
def test_visible_surfels_lie_in_their_bins_in_order(session, whole):
    if session.layout.pixels:
        pytest.skip("the layout by pixels draws without bins")
    surfels = case(CAMERA)[0]
    visible, view = Visible(session, on_device(session, surfels), CAMERA), View(session)
    view.show(POSE, SEEN, CONFIDENCE)
    visible.culling(view, discs=whole)()
    cull = reference.cull_discs if whole else reference.cull_points
    ids, bins = cull(surfels, POSE, SEEN, CONFIDENCE, CAMERA)
    expected = dict(zip(ids, bins, strict=True))
    starts = fetched(session, visible.starts, visible.bands + 2, np.int32)
    found = fetched(session, visible.sorted, starts[-1], np.int32)
    got_bins = np.repeat(np.arange(visible.bands + 1), np.diff(starts))
    got = dict(zip(found, got_bins, strict=True))
    wrong = {i for i in got.keys() | expected.keys() if got.get(i) != expected.get(i)}
    assert len(wrong) <= 0.02 * len(
        expected
    )  # a rim may lie within a hundredth of a pixel of a pixel's middle
    assert all(found[:-1][np.diff(got_bins) == 0] < found[1:][np.diff(got_bins) == 0])
    if not wrong:
        np.testing.assert_array_equal(starts, reference.bin_offsets(bins, visible.bands))
        np.testing.assert_array_equal(found, reference.scatter(ids, bins))
    assert len(set(got_bins)) == visible.bands + whole  # one bin more for discs that reach far


def small_image(seed: int, camera: Camera, holes: float) -> Thumbnail:
    random = np.random.default_rng(seed)
    shape = (camera.height, camera.width)
    there = random.random(shape) >= holes
    return Thumbnail(
        camera,
        (random.uniform(0.5, 3, shape) * there).astype(np.float32),
        (random.normal(size=(*shape, 3)) * there[..., None]).astype(np.float32),
        (random.integers(1, 1 << 24, shape) * (random.random(shape) >= holes)).astype(np.uint32),
    )


def device_image(session, image: Thumbnail):
    from slam.elasticfusion.images import RgbdImage

    there = RgbdImage.allocate(session, image.camera)
    thumbnail.write(session, there, image)
    return there


@pytest.mark.parametrize("keep_depth", [True, False])
@pytest.mark.parametrize("keep_colour", [True, False])
@pytest.mark.parametrize("holes", [True, False])
def test_fill_in(session, keep_depth, keep_colour, holes):
    predicted, live = small_image(2, CAMERA, 0.5), small_image(3, CAMERA, 0.2)
    filled = FillIn(session, device_image(session, predicted), device_image(session, live))
    filled.fill(keep_depth, keep_colour, holes)
    got = thumbnail.read(session, filled.image)
    expected = reference.fill_in(
        *((image.depth, image.normals, image.colour) for image in (predicted, live)),
        keep_depth,
        keep_colour,
        holes,
    )
    for one, other in zip((got.depth, got.normals, got.colour), expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("ratio", [1, 4, 5])
def test_sampling_keeps_the_geometry(session, ratio):
    image = small_image(5, MIRRORED, 0.3)
    small = Sampling(session, device_image(session, image), ratio).read()
    for name in ("depth", "normals", "colour", "vertices"):
        expected = reference.sample_image(getattr(image, name), ratio)
        np.testing.assert_allclose(getattr(small, name), expected, rtol=1e-4, atol=1e-5)
    assert small.camera == sampled(MIRRORED, ratio)
    assert small.depth.shape == (75 // ratio, 47 // ratio)


def test_a_thumbnail_of_another_size_is_not_written(session):
    image = small_image(6, CAMERA, 0.3)
    with pytest.raises(ValueError, match="23x37 pixels does not fit an image of 47x75"):
        thumbnail.write(session, device_image(session, image), small_image(6, sampled(CAMERA, 2), 0.3))


def test_a_map_gives_back_what_was_written(session):
    surfels = cluttered_map()
    there = on_device(session, surfels)
    np.testing.assert_array_equal(there.read(removed=True), surfels)
    np.testing.assert_array_equal(there.read(), surfels[surfels["confidence"] > 0])
    with pytest.raises(MapFullError, match="raise surfel_capacity"):
        there.write(np.zeros(there.capacity + 1, SURFEL))
    there.write(surfels[:0])
    assert len(there.read()) == there.count == 0
