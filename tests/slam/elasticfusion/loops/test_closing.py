"""Loops are closed where the evidence is good, and then map, keyframes and trajectory fit again."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slam.camera import Camera
from slam.elasticfusion.configuration import Configuration
from slam.elasticfusion.loops.closing import Closure, Grid, LoopClosing, Recognition
from slam.elasticfusion.loops.graph import Graph
from slam.elasticfusion.loops.thumbnail import Thumbnail
from slam.elasticfusion.tracking.odometry import Registration
from tests.slam.elasticfusion.walk import CAMERA, pose, view
from tests.slam.numpy_kernels.dense import exponential

LOOP = 120  # frames once round the room and a little farther
ANGLES = np.linspace(0, 2 * np.pi + 0.1, LOOP)
TRUTH = np.array([pose(angle) for angle in ANGLES])
VIEWS = [view(true) for true in TRUTH]
DRIFT = np.array([0.0006, 0.0012, 0.0004, 0.0004, 0.0001, -0.0001])  # a frame
TICK = LOOP  # of the last frame; the first has 1
CONFIGURATION = Configuration(time_window=40, depth_cutoff=4.0)


def registration(motion: np.ndarray, **values: object) -> Registration:
    """One without any objection, except `values`."""
    good = Registration(motion, 1e-5, 200_000, 100_000, 0.001, 0.001)
    return replace(good, **values)


def drifted() -> np.ndarray:
    """The trajectory as it is believed to be when every frame adds a little error."""
    poses = [TRUTH[0]]
    for before, after in itertools.pairwise(TRUTH):
        poses.append(poses[-1] @ np.linalg.inv(before) @ after @ exponential(DRIFT))
    return np.array(poses)


def mapped(poses: np.ndarray) -> Graph:
    """Three nodes a frame, where the drifting camera believes the walls to be."""
    nodes, times = [], []
    for tick, believed in enumerate(poses, start=1):
        points = VIEWS[tick - 1].vertices[[15, 30, 45], [20 + tick % 3, 40, 60 - tick % 3]]
        nodes.append(points @ believed[:3, :3].T + believed[:3, 3])
        times += [tick] * 3
    return Graph(np.concatenate(nodes), np.array(times))


def exact(seen: Thumbnail, key: Thumbnail) -> Registration:
    """What a registration without any error finds between two frames of the walk."""
    shown = next(index for index, picture in enumerate(VIEWS) if picture is key)
    return registration(np.linalg.inv(TRUTH[shown]) @ TRUTH[-1])


def walked(
    configuration: Configuration = CONFIGURATION, verify: Callable[..., Registration] = exact
) -> tuple[LoopClosing, np.ndarray]:
    """After the whole walk, with what the camera believes."""
    closing, believed = LoopClosing(configuration, CAMERA, verify), drifted()
    for tick, guess in enumerate(believed, start=1):
        closing.log(guess, tick)
        if tick % 4 == 1:
            closing.remember(VIEWS[tick - 1], guess, tick)
    return closing, believed


def error(poses: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - TRUTH)[:, :3, 3] ** 2, axis=1))))


def closed(configuration: Configuration = CONFIGURATION) -> tuple[LoopClosing, Recognition, Closure | None]:
    closing, believed = walked(configuration)
    recognition = closing.recognise(view(TRUTH[-1], noise=1), TICK, lost=False)
    assert recognition is not None
    return closing, recognition, closing.close_globally(recognition, believed[-1], mapped(believed), TICK)


def test_a_loop_of_drifted_poses_closes():
    closing, recognition, closure = closed()
    assert recognition.keyframe.tick < 20
    assert closure is not None
    assert not closure.local
    assert error(drifted()) > 0.09
    assert np.linalg.norm(drifted()[-1] - TRUTH[-1]) > 0.1
    np.testing.assert_allclose(closure.pose, recognition.pose)
    assert np.linalg.norm(closure.pose[:3, 3] - TRUTH[-1][:3, 3]) < 0.01
    assert error(closing.poses()) < 0.4 * error(drifted())


def test_the_map_fits_where_the_loop_closed():
    _, _, closure = closed()
    assert closure is not None
    seen = VIEWS[-1].vertices[::6, ::6].reshape(-1, 3)
    believed, true = (seen @ p[:3, :3].T + p[:3, 3] for p in (drifted()[-1], TRUTH[-1]))
    moved, _ = closure.deformation.of_points(believed, np.full(len(seen), TICK))
    assert np.linalg.norm(believed - true, axis=1).mean() > 0.1
    assert np.linalg.norm(moved - true, axis=1).mean() < 0.03


def test_a_second_global_closure_has_nothing_left_to_close():
    closing, _, closure = closed()
    assert closure is not None
    again = closing.recognise(view(TRUTH[-1], noise=2), TICK + 1, lost=False)
    assert again is not None
    assert closing.close_globally(again, closure.pose, mapped(closing.poses()), TICK + 1) is None


@pytest.mark.parametrize(
    "limit", [{"closure_distance": 0.5}, {"closure_error": 1e-9}, {"closure_energy": 1e-9}], ids=str
)
def test_a_global_closure_that_does_no_good_changes_nothing(limit):
    closing, _, closure = closed(replace(CONFIGURATION, **limit))
    assert closure is None
    np.testing.assert_array_equal(closing.poses(), drifted())


@pytest.mark.parametrize(
    "doubt",
    [
        {"icp_error": 5e-5},
        {"icp_inliers": 0.3 * 640 * 480},
        {"position_deviation": 0.0031},
        {"rotation_deviation": 0.0031},
        {"pose": exponential(np.array([0, 0, 0, 0, 3.0, 0]))},
    ],
    ids=["error", "inliers", "position", "rotation", "colour"],
)
def test_a_doubtful_view_is_not_recognised(doubt):
    closing, _ = walked(verify=lambda seen, key: replace(exact(seen, key), **doubt))
    assert closing.recognise(VIEWS[-1], TICK, lost=False) is None


def test_a_lost_camera_takes_newer_keyframes_and_fewer_inliers():
    few = 0.4 * 640 * 480
    closing, believed = walked(verify=lambda seen, key: replace(exact(seen, key), icp_inliers=few))
    assert closing.recognise(VIEWS[-1], TICK, lost=False) is None
    recognition = closing.recognise(VIEWS[-1], TICK, lost=True)
    assert recognition is not None
    recent, _ = walked(replace(CONFIGURATION, time_window=1000))
    assert recent.recognise(VIEWS[-1], TICK, lost=False) is None
    there = recent.recognise(VIEWS[-1], TICK, lost=True)
    assert there is not None
    key = there.keyframe
    np.testing.assert_allclose(
        there.pose, believed[key.tick - 1] @ np.linalg.inv(TRUTH[key.tick - 1]) @ TRUTH[-1]
    )


def test_an_empty_view_is_nowhere():
    closing, _ = walked()
    nothing = replace(VIEWS[0], depth=np.zeros((60, 80), np.float32), colour=np.zeros((60, 80), np.uint32))
    assert closing.recognise(nothing, TICK, lost=True) is None
    assert not closing.remember(nothing, np.eye(4), TICK)


def grid_of(tick: int = TICK) -> Grid:
    """The active view at the end of the walk, in front of what the first frames saw."""
    depth = VIEWS[-1].depth
    first_seen = np.full(depth.shape, tick - 5, np.int32)
    return Grid.sampled(depth, first_seen, np.full(depth.shape, 3, np.int32), CAMERA)


def test_a_local_closure_draws_the_active_model_onto_the_inactive_one():
    closing, believed = walked()
    grid = grid_of()
    offset = np.linalg.inv(believed[-1]) @ TRUTH[-1]
    closure = closing.close_locally(registration(offset), believed[-1], grid, mapped(believed), TICK)
    assert closure is not None
    assert closure.local
    np.testing.assert_allclose(closure.pose, TRUTH[-1], atol=1e-12)
    active, inactive = (grid.points @ p[:3, :3].T + p[:3, 3] for p in (believed[-1], TRUTH[-1]))
    moved, _ = closure.deformation.of_points(active, grid.times)
    pinned, _ = closure.deformation.of_points(inactive, grid.old_times)
    assert np.linalg.norm(active - inactive, axis=1).mean() > 0.1
    assert np.linalg.norm(moved - inactive, axis=1).mean() < 0.001
    assert np.linalg.norm(pinned - inactive, axis=1).mean() < 0.001
    assert error(closing.poses()) < 0.5 * error(believed)
    assert np.linalg.norm(closing.poses()[-1] - TRUTH[-1]) < 0.02


@pytest.mark.parametrize(
    "doubt",
    [
        {"position_deviation": 0.011},
        {"rotation_deviation": 0.011},
        {"icp_inliers": 35_000},
        {"icp_error": 5e-5},
        {"icp_error": np.nan},
    ],
    ids=["position", "rotation", "inliers", "error", "nan"],
)
def test_an_uncertain_registration_closes_nothing(doubt):
    closing, believed = walked()
    uncertain = registration(np.eye(4), **doubt)
    assert closing.close_locally(uncertain, believed[-1], grid_of(), mapped(believed), TICK) is None


def test_what_was_born_before_the_time_window_gives_no_pair_to_a_local_closure():
    offset = exponential(np.array([0.02, 0, 0, 0, 0, 0]))
    younger = grid_of()
    bridging = replace(younger, times=np.full(len(younger.times), TICK - CONFIGURATION.time_window))
    both = Grid(
        np.concatenate([younger.points, bridging.points]),
        np.concatenate([younger.times, bridging.times]),
        np.concatenate([younger.old_times, bridging.old_times]),
    )
    closures = {}
    for name, grid in (("younger", younger), ("bridging", bridging), ("both", both)):
        closing, believed = walked()
        closures[name] = closing.close_locally(
            registration(offset), believed[-1], grid, mapped(believed), TICK
        )
    assert closures["bridging"] is None
    assert closures["younger"] is not None
    assert closures["both"] is not None
    np.testing.assert_array_equal(
        closures["both"].deformation.translations, closures["younger"].deformation.translations
    )


def test_a_later_local_closure_leaves_in_place_what_an_earlier_one_put_there():
    closing, believed = walked()
    nodes = mapped(believed)
    offset = exponential(np.array([0.02, 0, 0, 0, 0, 0]))
    assert closing.close_locally(registration(offset), believed[79], grid_of(80), nodes, 80) is not None
    later = closing.close_locally(registration(offset), believed[-1], grid_of(), nodes, TICK)
    assert later is not None
    earlier = nodes.times <= 80
    assert not later.deformation.translations[earlier].any()
    assert later.deformation.translations[~earlier].any()


def test_a_global_closure_keeps_local_ones_closed():
    closing, believed = walked()
    nodes = mapped(believed)
    middle, here = 60, believed[59]
    grid = replace(grid_of(middle), old_times=np.full(len(grid_of().times), 25))
    first = closing.close_locally(registration(np.eye(4)), here, grid, nodes, middle)
    assert first is not None
    recognition = closing.recognise(VIEWS[-1], TICK, lost=False)
    assert recognition is not None
    second = closing.close_globally(recognition, believed[-1], nodes, TICK)
    alone = walked()[0].close_globally(recognition, believed[-1], nodes, TICK)
    assert second is not None
    assert alone is not None
    seam = grid.points @ here[:3, :3].T + here[:3, 3]

    def parted(closure: Closure) -> float:
        new, _ = closure.deformation.of_points(seam, grid.times)
        old, _ = closure.deformation.of_points(seam, grid.old_times)
        return float(np.linalg.norm(new - old, axis=1).mean())

    assert parted(second) < 0.5 * parted(alone)


def test_a_grid_holds_what_both_views_cover():
    camera = Camera(64.0, 64.0, 31.5, 23.5, 64, 48)
    depth = np.full((48, 64), 2.0, np.float32)
    first_seen, old_first_seen = np.full((48, 64), 9, np.int32), np.full((48, 64), 4, np.int32)
    assert len(Grid.sampled(depth, first_seen, old_first_seen, camera).times) == 32 * 24
    depth[:, :32], old_first_seen[:24] = 0, 0
    grid = Grid.sampled(depth, first_seen, old_first_seen, camera)
    assert len(grid.times) == 16 * 12
    assert (grid.points[:, :2] > 0).all()
    np.testing.assert_array_equal(np.unique(grid.points[:, 2]), [2.0])
    assert set(grid.times) == {9}
    assert set(grid.old_times) == {4}


def test_open_loop_recognises_without_scipy(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.sparse.linalg", None)
    with pytest.raises(ValueError, match="open_loop=true"):
        walked()
    closing, _ = walked(replace(CONFIGURATION, open_loop=True))
    assert closing.recognise(VIEWS[-1], TICK, lost=True) is not None


def test_two_walks_end_alike():
    np.testing.assert_array_equal(closed()[0].poses(), closed()[0].poses())
