"""A small map and frames of it, and a map on the device whose live frame is set by hand."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np

from slam.camera import Camera
from slam.dense.images import Vector3Image
from slam.elasticfusion.mapping.fusion import FRAME, Fusion
from slam.elasticfusion.mapping.surfels import RUN, SURFEL, Surfels
from tests.slam.numpy_kernels import fusion as reference
from tests.slam.numpy_kernels.dense import exponential, normal_map

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
    """The map of the reference."""
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
        "position_confidence": np.column_stack([surfels["position"], surfels["confidence"]]),
        "normal_radius": np.column_stack([surfels["normal"], surfels["radius"]]),
        "colour": surfels["colour"].copy(),
        "first_seen": surfels["first_seen"].copy(),
        "last_seen": surfels["last_seen"].copy(),
    }


def assert_same_maps(columns: dict[str, np.ndarray], expected: np.ndarray) -> None:
    for name, column in columns_of(expected).items():
        if name == "colour":
            for shift in (0, 8, 16):
                got, wanted = (values >> shift & 0xFF for values in (columns[name], column))
                assert abs(got.astype(int) - wanted.astype(int)).max() <= 1
        else:
            np.testing.assert_allclose(columns[name], column, rtol=2e-5, atol=2e-5, err_msg=name)


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
    surfels["first_seen"] = np.sort(random.integers(1, 60, count))
    surfels["last_seen"] = surfels["first_seen"] + random.integers(0, 30, count)
    return surfels


def uploaded(session, values: np.ndarray):
    buffer = session.buffer(values.nbytes)
    session.upload(buffer, values)
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
            normals=Vector3Image.allocate(session, pixels),
            colour=session.buffer(4 * pixels),
        )
        self.live = SimpleNamespace(filtered=session.buffer(4 * pixels), image=image)
        index_map = SimpleNamespace(ids=self.ids)
        self.fusion = Fusion(session, self.surfels, index_map, self.live, THRESHOLD)

    def see(self, live: SimpleNamespace, pose: np.ndarray) -> None:
        """Upload a frame, and the index map of what the map holds."""
        image, session = self.live.image, self.session
        session.upload(image.depth, live.raw.astype(np.float32))
        session.upload(self.live.filtered, live.filtered.astype(np.float32))
        for place, plane in zip(image.normals, planes(live.normals), strict=True):
            session.upload(place, plane)
        session.upload(image.colour, live.colour)
        session.upload(self.ids, index_of(self.surfels.read(removed=True), pose).astype(np.int32))

    def indexed(self) -> np.ndarray:
        ids = np.empty((CAMERA.height, CAMERA.width), np.int32)
        self.session.download(self.ids, ids)
        return ids
