"""Measuring a session with the real pipeline, and what is made of its runs."""

import json
from pathlib import Path
from typing import Any

import pytest

from client_kit import measurement
from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest
from client_kit.measurement import measure
from client_kit.session import Run, payload
from slam import benchmark
from slam.datasets import open_sequence
from slam.datasets.pack import Pack
from tests.client_kit import documents, room


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("room"))


@pytest.fixture
def asked(pack: Pack) -> Manifest:
    return Manifest.parse(room.manifest(pack))


def test_a_session_runs_default_best_best_default_over_all_frames(pack: Pack, asked: Manifest) -> None:
    told: list[Run] = []
    frames: list[tuple[str, int, int, float | None]] = []

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
    assert [frame[:3] for frame in frames[:2]] == [("warm-up, default", 1, 2), ("warm-up, default", 2, 2)]
    assert frames[-1] == ("run 4, default", room.FRAMES, room.FRAMES, 0.0)
    assert all(left is not None and left >= 0 for *_, left in frames)
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
    assert session.speedup("indivisible", asked.protocol) is None


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


def test_what_is_known_not_to_fit_is_recorded_and_never_tried(pack: Pack, asked: Manifest) -> None:
    seen: list[str] = []

    session = measure(
        pack,
        asked,
        ("default", "best"),
        impossible={"best": "volume_resolution=512 needs 640 MiB"},
        on_frame=lambda label, *_: seen.append(label),
    )

    assert [(run.status, run.failure) for run in session.runs] == [
        ("ok", None),
        ("failed", "volume_resolution=512 needs 640 MiB"),
    ]
    assert not [label for label in seen if "best" in label]


def test_ctrl_c_keeps_the_runs_that_are_finished(pack: Pack, asked: Manifest) -> None:
    def interrupt(label: str, done: int, *_: Any) -> None:
        if label == "run 3, best" and done == 5:
            raise KeyboardInterrupt

    session = measure(pack, asked, asked.plan(), on_frame=interrupt)

    assert session.interrupted
    assert [run.configuration for run in session.runs] == ["default", "best"]
    assert session.speedup("best", asked.protocol) is not None


def test_ctrl_c_before_the_first_run_is_over_leaves_nothing(pack: Pack, asked: Manifest) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(pack, asked, asked.plan(), on_frame=interrupt)


def test_runs_are_repeated_while_the_interval_is_wide_and_there_is_time(pack: Pack) -> None:
    changes = {"max_repeats": 4, "precision": 0.0, "warmup_frames": 0}
    protocol = {**documents.manifest()["protocol"], **changes}
    asked = Manifest.parse(room.manifest(pack, protocol=protocol))
    hurried = Manifest.parse(room.manifest(pack, protocol={**protocol, "max_seconds": 0}))

    long, short = measure(pack, asked, asked.plan()), measure(pack, hurried, hurried.plan())

    abba = ["default", "best", "best", "default"]
    assert [run.configuration for run in long.runs] == abba * 2
    assert [run.repeat for run in long.of("default")] == [0, 1, 2, 3]
    assert [run.configuration for run in short.runs] == abba


def test_a_run_that_loses_the_camera_is_failed_and_keeps_its_times(
    pack: Pack, asked: Manifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Lost(benchmark.Report):
        def to_dict(self) -> dict[str, Any]:
            told = super().to_dict()
            for frame in told["frames"][5:]:
                frame["tracked"] = False
            return told

    real = benchmark.run
    monkeypatch.setattr(benchmark, "run", lambda *a, **k: Lost(**vars(real(*a, **k))))

    [run] = measure(pack, asked, ("default",)).runs

    assert (run.status, run.failure) == ("failed", "tracking lost in 7 of 8 frames")
    assert len(run.frame_us) == room.FRAMES


def test_a_device_that_breaks_down_for_good_fails_run_by_run(
    pack: Pack, asked: Manifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> Any:
        raise RuntimeError("CL_OUT_OF_RESOURCES")

    monkeypatch.setattr(measurement, "open_session", broken)

    session = measure(pack, asked, ("default", "best"))

    assert {run.failure for run in session.runs} == {"RuntimeError: CL_OUT_OF_RESOURCES"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("clang: /home/anna/x/kernel.cl:3: error", "clang: kernel.cl:3: error"),
        (repr(r"C:\Users\Anna Smith\cache\kernel.cl"), "'kernel.cl'"),
        (r"C:\Users\anna\cache\kernel.cl is gone", "kernel.cl is gone"),
        ("compute_size_ratio=7: 320/7 is no whole number", "compute_size_ratio=7: 320/7 is no whole number"),
    ],
)
def test_a_failure_tells_no_folder(text: str, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)

    assert measurement._failure(OSError(text)) == f"OSError: {told}"
