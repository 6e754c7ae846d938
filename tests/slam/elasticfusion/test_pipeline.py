"""ElasticFusion over small recordings: what it reaches, and what each of its parameters does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from slam.camera import Camera
from slam.configuration import ConfigurationError
from slam.devices.choice import choose_device
from slam.devices.opencl import Session
from slam.elasticfusion.configuration import Configuration
from slam.elasticfusion.loops.registration import Loops
from slam.elasticfusion.mapping.surfels import MapFullError
from slam.elasticfusion.pipeline import ElasticFusion, velocity_weight
from slam.system import STAGES, Exporting, LoopCounts, Revising, Scene
from tests.slam.elasticfusion.room import CAMERA, Recording, record, sideways, there_and_back, turned
from tests.slam.numpy_kernels.dense import exponential

# Small maps: what is not reserved need not be cleared.
SMALL = {"surfel_capacity": 200_000}


class Run:
    """A recording that a system has seen to its end."""

    def __init__(
        self, session: Session, recording: Recording, camera: Camera = CAMERA, **settings: object
    ) -> None:
        scene = Scene(camera, 5.0, (0.5, 0.5, 0.1))
        self.system = ElasticFusion(Configuration.from_mapping(SMALL | settings), scene, session)
        self.frames = [
            self.system.process(depth, colour)
            for depth, colour in zip(recording.depth, recording.colour, strict=True)
        ]
        self.poses = self.system.poses()
        self.online = np.array([frame.pose for frame in self.frames])
        self.tracked = [frame.tracked for frame in self.frames]
        self.errors = np.linalg.norm(self.poses[:, :3, 3] - recording.truth[:, :3, 3], axis=1)


@pytest.fixture(scope="module")
def cpu() -> Session:
    return Session(choose_device())


@pytest.fixture(scope="module")
def turn() -> Recording:
    """Thirty frames: fifteen degrees to the right, and back."""
    return record(there_and_back(30, 15.0))


@pytest.fixture(scope="module")
def plain(cpu, turn) -> Run:
    """The result of the defaults on it."""
    return Run(cpu, turn)


@pytest.mark.slow
def test_it_follows_the_camera_on_every_device(session, turn):
    run = Run(session, turn)
    assert run.errors.max() < 0.004
    assert run.tracked == [None] + [True] * 29
    assert all(frame.integrated for frame in run.frames)
    assert all(set(frame.seconds) == set(STAGES) for frame in run.frames)


@pytest.mark.slow
def test_two_runs_give_the_same_bits(cpu, turn, plain):
    again = Run(cpu, turn)
    np.testing.assert_array_equal(plain.poses, again.poses)
    np.testing.assert_array_equal(plain.system.surfels.read(), again.system.surfels.read())


@pytest.mark.slow
def test_colour_holds_on_to_a_flat_wall_that_depth_alone_slides_along(cpu):
    wall = record(sideways(15, 0.008), wall_only=True)
    by_both, by_colour = Run(cpu, wall), Run(cpu, wall, icp_weight=0)
    by_depth = Run(cpu, wall, icp_weight=100)
    assert max(by_both.errors.max(), by_colour.errors.max()) < 0.005
    assert by_depth.errors[-1] > 0.1
    assert not any(by_depth.tracked)
    assert not np.array_equal(by_both.poses, by_colour.poses)


@pytest.mark.slow
def test_what_lies_beyond_the_cutoff_does_not_enter_the_map(cpu):
    still = record(sideways(2, 0.0))
    near, far = (Run(cpu, still, depth_cutoff=cutoff).system.surfels.read() for cutoff in (1.6, 5.0))
    assert near["position"][:, 2].max() <= 1.6
    assert far["position"][:, 2].max() > 1.7


@pytest.mark.slow
def test_surfels_are_stable_from_the_confidence_threshold_on(cpu, turn, tmp_path):
    exported = {}
    for threshold in (2, 6):
        run = Run(cpu, turn, confidence_threshold=threshold)
        stable = int((run.system.surfels.read()["confidence"] >= threshold).sum())
        assert run.system.export(tmp_path / "map.ply").startswith(f"{stable} stable surfels")
        exported[threshold] = stable
    assert 0 < exported[6] < exported[2]


def test_a_ratio_takes_every_so_manieth_pixel_and_nothing_else(cpu, turn):
    """The same bits as from a camera that has only those pixels."""
    few = Recording(
        [image[::2, ::2] for image in turn.depth], [image[::2, ::2] for image in turn.colour], turn.truth
    )
    sampled, small = Run(cpu, turn, compute_size_ratio=2), Run(cpu, few, CAMERA.scaled(2))
    np.testing.assert_array_equal(sampled.poses, small.poses)
    np.testing.assert_array_equal(sampled.system.surfels.read(), small.system.surfels.read())
    assert sampled.errors.max() < 0.01
    assert sampled.system.view().vertices.shape == (60, 80, 3)


def test_alignment_by_rotation_bridges_turns_that_are_lost_without_it(cpu):
    hurried = record(there_and_back(12, 50.0))
    assert Run(cpu, hurried).errors.max() < 0.01
    assert Run(cpu, hurried, disable_so3=True).errors.max() > 0.1


def test_fast_odometry_sees_no_colour_on_the_coarse_levels(cpu):
    """On paint without edges the finest level alone has nothing steep enough to hold on to."""
    smooth = record(sideways(10, 0.02), wall_only=True, smooth=True)
    assert Run(cpu, smooth).errors.max() < 0.01
    assert Run(cpu, smooth, fast_odometry=True).errors[-1] > 0.1


@pytest.mark.slow
def test_fast_odometry_follows_the_camera_where_there_are_edges(cpu, turn):
    assert Run(cpu, turn, fast_odometry=True).errors.max() < 0.004


@pytest.mark.slow
def test_colour_of_the_previous_frame_outlives_a_change_of_light(cpu):
    light = np.where(np.arange(16) < 6, 1.0, 0.6)
    dimmed = record(sideways(16, 0.012), wall_only=True, light=light)
    to_frame = Run(cpu, dimmed, frame_to_frame_rgb=True, confidence_threshold=1)
    to_model = Run(cpu, dimmed, confidence_threshold=1)
    assert all(to_frame.tracked[8:])
    assert sum(map(bool, to_model.tracked[8:])) < 4


@pytest.mark.slow
def test_a_camera_that_was_blinded_while_it_moved_finds_itself_again(cpu):
    blinded = record(there_and_back(60, 40.0)).dark(12, 36)
    found = Run(cpu, blinded)
    assert found.tracked[12:37] == [False] * 25
    assert all(found.tracked[50:])
    assert found.errors[50:].max() < 0.005
    assert found.system.loop_counts() == LoopCounts(relocalisations=1)
    unaware = Run(cpu, blinded, relocalisation=False)
    assert unaware.errors[50:].max() > 0.03
    assert unaware.system.loop_counts().relocalisations == 0


def test_nothing_is_fused_while_the_camera_is_lost(cpu):
    blinded = record(there_and_back(40, 20.0)).dark(4, 25)
    run = Run(cpu, blinded)
    assert not any(frame.integrated for frame in run.frames[4:26])
    assert run.tracked[4:26] == [False] * 22


def test_what_a_badly_tracked_frame_shows_becomes_no_keyframe(cpu, turn, monkeypatch):
    remembered = []
    monkeypatch.setattr(Loops, "remember", lambda *seen: remembered.append(seen[-1] - 1))
    run = Run(cpu, turn.dark(4, 7))
    assert run.tracked[4:8] == [False] * 4
    assert remembered == [index for index, tracked in enumerate(run.tracked) if tracked is not False]


def test_wide_and_low_images_leave_thumbnails_with_three_levels(cpu):
    system = ElasticFusion(
        Configuration.from_mapping(SMALL),
        Scene(Camera(900.0, 900.0, 639.5, 15.5, 1280, 32), 5.0, (0, 0, 0)),
        cpu,
    )
    depth, colour = np.full((32, 1280), 1500, np.uint16), np.full((32, 1280, 3), 128, np.uint8)
    assert system.process(depth, colour).integrated


@pytest.mark.slow
def test_closing_loops_mends_what_a_badly_calibrated_camera_makes_of_a_turn(cpu):
    once_round = record(np.array([turned(angle) for angle in np.radians(np.linspace(0, 420, 60))]))
    claimed = dataclasses.replace(CAMERA, fx=1.04 * CAMERA.fx, fy=1.04 * CAMERA.fy)
    settings = {"confidence_threshold": 1, "time_window": 12}
    closed = Run(cpu, once_round, claimed, **settings)
    left_open = Run(cpu, once_round, claimed, open_loop=True, **settings)
    assert closed.errors.mean() < 0.8 * left_open.errors.mean()
    assert closed.system.loop_counts().local > 0
    assert left_open.system.loop_counts() == LoopCounts()
    # Closing a loop corrects what was said of earlier frames.
    assert not np.array_equal(closed.poses, closed.online)
    np.testing.assert_array_equal(left_open.poses, left_open.online)


def test_a_map_that_is_full_says_what_would_help(cpu, turn):
    with pytest.raises(MapFullError, match="surfel_capacity=19300: raise it"):
        Run(cpu, turn, surfel_capacity=19_300)


def test_dark_frames_at_the_start_make_no_map_and_the_first_that_shows_something_does(cpu, turn):
    run = Run(cpu, turn.dark(0, 3))
    assert run.tracked == [None] * 5 + [True] * 25
    assert [frame.integrated for frame in run.frames[:6]] == [False] * 4 + [True] * 2
    assert run.system.view() is not None


def test_it_shows_what_it_sees(cpu, turn):
    system = ElasticFusion(Configuration.from_mapping(SMALL), Scene(CAMERA, 5.0, (0.5, 0.5, 0.1)), cpu)
    assert system.view() is None
    assert isinstance(system, Revising)
    assert isinstance(system, Exporting)
    system.process(turn.depth[0], turn.colour[0])
    view = system.view()
    assert view.vertices.shape == view.normals.shape == view.colour.shape == (120, 160, 3)
    assert np.median(np.abs(view.vertices[..., 2] - turn.depth[0] / 1000)) < 0.002
    np.testing.assert_array_equal(view.colour[60, 80], turn.colour[0][60, 80])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("depth", "colour", "words"),
    [
        (np.zeros((120, 160), np.float32), np.zeros((120, 160, 3), np.uint8), r"uint16 \(120, 160\)"),
        (np.zeros((120, 160), np.uint16), None, "uint8 .*got none"),
        (np.zeros((120, 160), np.uint16), np.zeros((120, 160), np.uint8), "uint8 .*got uint8"),
    ],
)
def test_images_of_another_kind_are_refused(cpu, depth, colour, words):
    system = ElasticFusion(Configuration.from_mapping(SMALL), Scene(CAMERA, 5.0, (0.5, 0.5, 0.1)), cpu)
    with pytest.raises(ValueError, match=words):
        system.process(depth, colour)


@pytest.mark.parametrize(
    ("camera", "values", "words"),
    [
        (CAMERA, {"surfel_capacity": 1000}, "surfel_capacity=1000: a frame alone makes up to 19200"),
        (
            Camera(20.0, 20.0, 11.5, 8.5, 24, 18),
            {},
            "images of 24x18: ElasticFusion needs 32 pixels each way$",
        ),
        (CAMERA, {"compute_size_ratio": 4}, "images of 40x30: .* way: lower compute_size_ratio=4"),
        (CAMERA, {"compute_size_ratio": 3}, "compute_size_ratio=3: ratio 3 must be .* divisor of 160x120"),
    ],
)
def test_what_cannot_be_run_says_why(cpu, camera, values, words):
    with pytest.raises(ConfigurationError, match=words):
        ElasticFusion(Configuration.from_mapping(values), Scene(camera, 5.0, (0.5, 0.5, 0.1)), cpu)


def test_a_frame_counts_less_the_faster_the_camera_moves():
    still, slow, fast = np.eye(4), np.eye(4), np.eye(4)
    slow[0, 3], fast[0, 3] = 0.002, 0.03
    assert velocity_weight(still) == 1
    assert velocity_weight(slow) == pytest.approx(0.8)
    assert velocity_weight(fast) == 0.5
    assert velocity_weight(exponential(np.array([0, 0, 0, 0, 0.004, 0]))) == pytest.approx(0.6)
