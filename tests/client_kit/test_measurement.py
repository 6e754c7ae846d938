"""Measuring a session with the real pipeline, and what is made of its runs."""

import json
from pathlib import Path
from typing import Any

import pytest

from client_kit.bench import Outcome
from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest
from client_kit.measurement import _recorded, measure
from client_kit.sensors import Sample
from client_kit.session import Run, payload
from slam.datasets.pack import Pack
from tests.client_kit import documents, room

PLAN = ("default", "best", "indivisible", "best", "default")
Told = tuple[str, int, int, float | None]


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("room"))


@pytest.fixture(scope="module")
def asked(pack: Pack) -> Manifest:
    return Manifest.parse(room.manifest(pack))


class Watched:
    """A session that was really measured, with all that was told meanwhile."""

    def __init__(self, folder: Path, asked: Manifest) -> None:
        self.runs: list[Run] = []
        self.frames: list[Told] = []
        self.session = measure(
            folder, asked, PLAN, on_run=self.runs.append, on_frame=lambda *told: self.frames.append(told)
        )


@pytest.fixture(scope="module")
def watched(pack: Pack, asked: Manifest) -> Watched:
    return Watched(pack._chunks.folder, asked)


def test_a_session_runs_its_plan_over_all_frames(watched: Watched) -> None:
    runs, frames = watched.session.runs, watched.frames

    assert [(run.configuration, run.repeat, run.order) for run in runs] == [
        ("default", 0, 0), ("best", 0, 1), ("indivisible", 0, 2), ("best", 1, 3), ("default", 1, 4),
    ]  # fmt: skip
    assert watched.runs == list(runs)
    for run in (*runs[:2], *runs[3:]):
        assert run.status == "ok"
        assert len(run.frame_us) == room.FRAMES
        assert all(time > 0 for time in run.frame_us)
        assert all(sum(stages) <= total for stages, total in zip(
            zip(*run.stages_us.values(), strict=True), run.frame_us, strict=True))  # fmt: skip
        assert run.tracked == (None,) * 4 + (True,) * (room.FRAMES - 4)
        assert run.ate_max is not None
        assert run.ate_max < 0.05
    assert [frame[:3] for frame in frames[:2]] == [("warm-up, default", 1, 2), ("warm-up, default", 2, 2)]
    assert frames[-1] == ("run 5, default", room.FRAMES, room.FRAMES, 0.0)
    assert all(left is not None and left >= 0 for *_, left in frames)
    # The same configuration computes the same trajectory.
    digests = [run.trajectory_sha256 for run in runs]
    assert digests[0] == digests[4] != digests[1] == digests[3]


def test_a_configuration_that_fails_here_is_recorded_and_the_others_go_on(
    watched: Watched, asked: Manifest
) -> None:
    failed = watched.session.runs[2]

    assert failed.status == "failed"
    assert "compute_size_ratio=7" in (failed.failure or "")
    document = payload(watched.session, asked, {})["sessions"][0]["runs"][2]
    assert (document["frame_us"], document["ate_max"]) == ([], None)
    assert watched.session.speedup("indivisible", asked.protocol) is None


def test_the_payload_is_what_the_interface_says(watched: Watched, asked: Manifest) -> None:
    document = payload(watched.session, asked, {"model": "Pixel 8", "cpu": None})

    sent = json.loads(json.dumps(document, allow_nan=False))

    assert set(sent) == {"schema_version", "app_version", "consent_version", "device", "sessions"}
    assert sent["device"] == {"model": "Pixel 8", "cpu": None}
    [told] = sent["sessions"]
    assert told["application"] == "kfusion"
    assert told["front_version"] == "1"
    assert told["protocol_version"] == 1
    assert told["backend"] == "opencl"
    assert told["started_at"].endswith("Z")
    assert set(told["samples"][0]) == set(Sample.__annotations__)
    run = told["runs"][0]
    assert set(run["stages_us"]) == {"preprocessing", "tracking", "integration", "raycasting"}
    assert all(len(series) == room.FRAMES for series in run["stages_us"].values())
    assert all(type(time) is int for time in run["frame_us"])


def test_without_a_device_nothing_is_measured(pack: Pack, asked: Manifest) -> None:
    with pytest.raises(CannotMeasureError, match="no OpenCL device matches 'abacus'"):
        measure(pack._chunks.folder, asked, asked.plan(), device="abacus")


def test_a_sequence_that_cannot_serve_is_not_blamed_on_a_configuration(tmp_path: Path) -> None:
    pack = room.write(tmp_path / "room")
    asked = Manifest.parse(room.manifest(pack))
    long = Manifest.parse(room.manifest(pack, protocol={**documents.manifest()["protocol"], "frames": 100}))
    last = tmp_path / "room" / "chunks" / pack.manifest["chunks"][-1]["sha256"]

    with pytest.raises(CannotMeasureError, match="12 frames, the protocol measures 100"):
        measure(tmp_path / "room", long, ("default",))
    last.write_bytes(last.read_bytes()[:-1])
    with pytest.raises(CannotMeasureError, match="damaged"):
        measure(tmp_path / "room", asked, ("default",))
    (tmp_path / "room" / "pack.json").write_text("{")
    with pytest.raises(CannotMeasureError, match=r"pack\.json"):
        measure(tmp_path / "room", asked, ("default",))


def recorded(tracked: list[bool | None], worst: float = 0.01) -> Run:
    stages = dict.fromkeys(("preprocessing", "tracking", "integration", "raycasting"), 0.0024999)
    frames: list[dict[str, Any]] = [{"computation": 0.01, **stages, "tracked": told} for told in tracked]
    ate = {"max": worst, "mean": 0.005, "rmse": 0.006}
    return _recorded("an id", "best", 1, 2, Outcome({"frames": frames, "ate": ate}, "digest"))


def test_a_run_that_loses_the_camera_is_failed_and_keeps_its_times() -> None:
    lost, held = recorded([None] * 4 + [True] + [False] * 7), recorded([None] * 4 + [True] * 4 + [False] * 4)

    assert (lost.status, lost.failure) == ("failed", "tracking lost in 7 of 8 frames")
    assert lost.frame_us == (10_000,) * 12
    assert lost.stages_us["tracking"] == (2499,) * 12  # never more than the frame in all
    assert (held.status, held.failure) == ("ok", None)


def test_a_trajectory_that_is_not_finite_is_a_failure_without_times() -> None:
    run = recorded([True] * 12, float("nan"))

    assert (run.status, run.failure, run.frame_us) == ("failed", "the trajectory is not finite", ())
