"""Measuring a session with the real pipeline, and what is made of its runs."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from client_kit import measurement
from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest
from client_kit.measurement import Run, Session, measure, payload
from slam.datasets import open_sequence
from slam.datasets.pack import Pack
from tests.client_kit import documents, room

PROTOCOL = Manifest.parse(documents.manifest()).protocol


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("room"))


@pytest.fixture
def asked(pack: Pack) -> Manifest:
    return Manifest.parse(room.manifest(pack))


def test_a_session_runs_default_best_best_default_over_all_frames(pack: Pack, asked: Manifest) -> None:
    told: list[Run] = []
    frames: list[tuple[str, int, int]] = []

    session = measure(
        pack, asked, asked.plan(), on_run=told.append, on_frame=lambda *frame: frames.append(frame)
    )

    assert [(run.configuration, run.repeat, run.order) for run in session.runs] == [
        ("default", 0, 0), ("best", 0, 1), ("best", 1, 2), ("default", 1, 3),
    ]  # fmt: skip
    assert told == list(session.runs)
    for run in session.runs:
        assert run.status == "ok"
        assert len(run.frame_us) == room.FRAMES
        assert all(time > 0 for time in run.frame_us)
        assert all(sum(stages) <= total for stages, total in zip(
            zip(*run.stages_us.values(), strict=True), run.frame_us, strict=True))  # fmt: skip
        assert run.tracked == (None,) * 4 + (True,) * (room.FRAMES - 4)
        assert run.ate_max is not None
        assert run.ate_max < 0.05
    assert frames[:2] == [("warm-up, default", 1, 2), ("warm-up, default", 2, 2)]
    assert frames[-1] == ("run 4 of 4, default", room.FRAMES, room.FRAMES)
    # The same configuration computes the same trajectory.
    digests = [run.trajectory_sha256 for run in session.runs]
    assert digests[0] == digests[3] != digests[1] == digests[2]


def test_the_payload_is_what_the_interface_says(pack: Pack, asked: Manifest) -> None:
    session = measure(pack, asked, ("default",))

    sent = json.loads(json.dumps(payload(session, asked, {"model": "Pixel 8", "cpu": None}), allow_nan=False))

    assert set(sent) == {"schema_version", "app_version", "consent_version", "device", "sessions"}
    assert sent["device"] == {"model": "Pixel 8", "cpu": None}
    [told] = sent["sessions"]
    assert told["application"] == "kfusion"
    assert told["front_version"] == "1"
    assert told["protocol_version"] == 1
    assert told["backend"] == "opencl"
    assert told["started_at"].endswith("Z")
    assert set(told["samples"][0]) == {"t", "temperature_c", "cpu_mhz", "battery"}
    [run] = told["runs"]
    assert set(run["stages_us"]) == {"preprocessing", "tracking", "integration", "raycasting"}
    assert all(len(series) == room.FRAMES for series in run["stages_us"].values())
    assert all(type(time) is int for time in run["frame_us"])


def test_a_configuration_that_fails_here_is_recorded_and_the_others_go_on(
    pack: Pack, asked: Manifest
) -> None:
    session = measure(pack, asked, ("default", "indivisible", "indivisible", "default"))

    assert [run.status for run in session.runs] == ["ok", "failed", "failed", "ok"]
    assert "compute_size_ratio=7" in (session.runs[1].failure or "")
    document = payload(session, asked, {})["sessions"][0]["runs"][1]
    assert (document["frame_us"], document["ate_max"]) == ([], None)
    assert session.speedup("indivisible", PROTOCOL) is None


def test_between_runs_the_device_rests_as_the_protocol_says(pack: Pack) -> None:
    protocol = {**documents.manifest()["protocol"], "rest_seconds": 7.5, "warmup_frames": 0}
    asked = Manifest.parse(room.manifest(pack, protocol=protocol))
    rests: list[float] = []

    measure(pack, asked, ("default", "default"), rest=rests.append)

    assert rests == [7.5]


def test_without_a_device_nothing_is_measured(pack: Pack, asked: Manifest) -> None:
    with pytest.raises(CannotMeasureError, match="no OpenCL device matches 'abacus'"):
        measure(pack, asked, asked.plan(), device="abacus")


def test_a_damaged_sequence_is_not_blamed_on_a_configuration(tmp_path: Path) -> None:
    pack = room.write(tmp_path / "room")
    asked = Manifest.parse(room.manifest(pack))
    last = tmp_path / "room" / "chunks" / pack.manifest["chunks"][-1]["sha256"]
    last.write_bytes(last.read_bytes()[:-1])

    with pytest.raises(CannotMeasureError, match="damaged"):
        measure(open_sequence(tmp_path / "room"), asked, asked.plan())


def test_a_sequence_shorter_than_the_protocol_is_refused(pack: Pack) -> None:
    protocol = {**documents.manifest()["protocol"], "frames": 100}

    with pytest.raises(CannotMeasureError, match="12 frames, the protocol measures 100"):
        measure(pack, Manifest.parse(room.manifest(pack, protocol=protocol)), ("default",))


def test_a_failure_does_not_tell_the_users_name() -> None:
    error = FileNotFoundError(f"{Path.home()}/.cache/kernel missing\nand more")

    assert measurement._failure(error) == "FileNotFoundError: ~/.cache/kernel missing and more"


def run_of(configuration: str, repeat: int, milliseconds: list[float], ate_max: float | None = 0.01) -> Run:
    times = tuple(round(1000 * time) for time in milliseconds)
    return Run("id", configuration, repeat, 0, "ok", frame_us=times, ate_max=ate_max)


def session_of(*runs: Run) -> Session:
    return Session("id", "2026-01-01T00:00:00Z", "opencl", runs, ())


def test_the_speedup_is_the_geometric_mean_of_the_paired_ratios() -> None:
    session = session_of(
        run_of("default", 0, [900] * 4 + [40] * 8),
        run_of("best", 0, [900] * 4 + [10] * 8),
        run_of("best", 1, [900] * 4 + [20] * 8),
        run_of("default", 1, [900] * 4 + [180] * 8),
    )

    assert session.speedup("best", PROTOCOL) == pytest.approx(math.sqrt((40 / 10) * (180 / 20)))


def test_work_done_in_few_frames_counts_in_full() -> None:
    session = session_of(run_of("default", 0, [10] * 12), run_of("best", 0, [1] * 4 + [33] + [1] * 7))

    assert session.speedup("best", PROTOCOL) == pytest.approx(10 / 5)


@pytest.mark.parametrize("ate_max", [0.05, 3.0, None])
def test_a_run_whose_trajectory_is_off_makes_no_speedup(ate_max: float | None) -> None:
    base = run_of("default", 0, [40] * 12)
    bad, good = run_of("best", 0, [10] * 12, ate_max), run_of("best", 1, [20] * 12)

    assert session_of(base, bad).speedup("best", PROTOCOL) is None
    both: Any = session_of(base, bad, good, run_of("default", 1, [40] * 12))
    assert both.speedup("best", PROTOCOL) == pytest.approx(2)
