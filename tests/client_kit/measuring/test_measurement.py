"""Measuring a session with the real pipeline, and what is made of its runs."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from client_kit.delivery.manifest import Manifest, version_numbers
from client_kit.device.sensors import Sample
from client_kit.errors import CannotMeasureError
from client_kit.measuring.measurement import measure
from client_kit.measuring.session import Run, payload
from frontrunner import session_statistics
from slam.datasets.formats.pack import Pack
from slam.devices.choice import choose_device, list_devices
from slam.devices.device import BACKENDS
from tests.builders import manifests
from tests.client_kit import room

PLAN = ("default", "best", "indivisible", "best", "default")
Frame = tuple[str, int, int, float | None]


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("room"))


@pytest.fixture(scope="module")
def asked(pack: Pack) -> Manifest:
    return Manifest.parse(room.manifest(pack))


class Watched:
    """A session that was really measured, with all progress calls."""

    def __init__(self, folder: Path, asked: Manifest) -> None:
        self.runs: list[Run] = []
        self.frames: list[Frame] = []
        self.session = measure(
            folder,
            asked,
            PLAN,
            choose_device(),
            references=room.references(asked),
            on_run=self.runs.append,
            on_frame=lambda *frame: self.frames.append(frame),
        )


@pytest.fixture(scope="module")
def watched(pack: Pack, asked: Manifest) -> Iterator[Watched]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session_statistics, "MOST_WAITED", math.inf)  # other tests disturb this machine
        yield Watched(pack._chunks.folder, asked)


@pytest.mark.slow
def test_a_session_runs_its_plan_over_all_frames(watched: Watched) -> None:
    runs = watched.session.runs
    frames = [frame for frame in watched.frames if not frame[0].startswith("compiling")]

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
    assert frames[-1] == ("default, run 5 of 5", room.FRAMES, room.FRAMES, 0.0)
    assert all(left is not None and left >= 0 for *_, left in frames)
    # The same configuration computes the same trajectory.
    deviations = [run.deviation for run in runs]
    assert deviations[0] == deviations[4] != deviations[1] == deviations[3]


@pytest.mark.slow
def test_a_configuration_that_fails_here_is_recorded_and_the_others_go_on(
    watched: Watched, asked: Manifest
) -> None:
    failed = watched.session.runs[2]

    assert failed.status == "failed"
    assert "compute_size_ratio=7" in (failed.failure or "")
    document = payload(watched.session, asked, {})["sessions"][0]["runs"][2]
    assert (document["frame_us"], document["ate_max"]) == ([], None)
    assert watched.session.speedup("indivisible", asked.protocol) is None


@pytest.mark.slow
def test_the_payload_is_what_the_interface_says(watched: Watched, asked: Manifest) -> None:
    document = payload(watched.session, asked, {"model": "Pixel 8", "cpu": None})

    sent = json.loads(json.dumps(document, allow_nan=False))

    assert set(sent) == {"schema_version", "app_version", "consent_version", "device", "sessions"}
    # Since 0.2.0 a frame of KinectFusion is taken with one synchronisation: its times are others.
    assert version_numbers(sent["app_version"]) >= (0, 2, 0)
    assert sent["device"] == {"model": "Pixel 8", "cpu": None}
    [session] = sent["sessions"]
    assert session["application"] == "kfusion"
    assert session["front_version"] == "1"
    assert session["protocol_version"] == 2
    assert session["backend"] == "opencl"
    assert session["started_at"].endswith("Z")
    assert set(session["samples"][0]) == set(Sample.__annotations__)
    run = session["runs"][0]
    assert set(run["stages_us"]) == {"preprocessing", "tracking", "integration", "raycasting"}
    assert all(len(series) == room.FRAMES for series in run["stages_us"].values())
    assert all(type(time) is int for time in run["frame_us"])


@pytest.mark.slow
def test_where_the_device_is_gone_nothing_is_measured(pack: Pack, asked: Manifest) -> None:
    gone = replace(choose_device(), name="abacus")

    with pytest.raises(CannotMeasureError, match="no OpenCL device matches 'abacus"):
        measure(pack._chunks.folder, asked, asked.plan(), gone, references=room.references(asked))


@pytest.mark.slow
def test_a_sequence_that_cannot_serve_is_not_blamed_on_a_configuration(tmp_path: Path) -> None:
    pack = room.write(tmp_path / "room")
    asked = Manifest.parse(room.manifest(pack))
    long = Manifest.parse(room.manifest(pack, protocol={**manifests.manifest()["protocol"], "frames": 100}))
    references = room.references(asked)
    last = tmp_path / "room" / "chunks" / pack.manifest["chunks"][-1]["sha256"]

    with pytest.raises(CannotMeasureError, match="12 frames, the protocol measures 100"):
        measure(tmp_path / "room", long, ("default",), choose_device(), references=references)
    last.write_bytes(last.read_bytes()[:-1])
    with pytest.raises(CannotMeasureError, match="damaged"):
        measure(tmp_path / "room", asked, ("default",), choose_device(), references=references)
    (tmp_path / "room" / "pack.json").write_text("{")
    with pytest.raises(CannotMeasureError, match=r"pack\.json"):
        measure(tmp_path / "room", asked, ("default",), choose_device(), references=references)


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_each_run_is_compared_with_its_reference(backend: str, pack: Pack) -> None:
    devices = list_devices(backend)
    if not devices:
        pytest.skip(f"no device over {backend} here")
    asked = Manifest.parse(room.manifest(pack, far=("best",)))

    done = measure(pack._chunks.folder, asked, asked.plan(), devices[0], references=room.references(asked))

    assert [(run.configuration, run.status) for run in done.runs] == [
        ("default", "ok"), ("best", "ok"), ("best", "ok"), ("default", "ok"),
    ]  # fmt: skip
    near, far, *_ = done.runs
    assert near.deviation is not None
    assert far.deviation is not None
    assert 0 < near.deviation < room.BAND < far.deviation < 0.15
    assert not near.deviates
    assert done.speedup("best", asked.protocol) is None
    [sent] = json.loads(json.dumps(payload(done, asked, {}), allow_nan=False))["sessions"]
    assert (sent["protocol_version"], sent["backend"]) == (2, backend)
    assert 0 < sent["empty_frame_us"] < 60e6
    assert (
        sent["stage_clock"] in {"opencl": ("device", "none"), "webgpu": ("none",), "wasm": ("wall",)}[backend]
    )
    assert sent.get("threads") == (devices[0].compute_units if backend == "wasm" else None)
    for run in sent["runs"]:
        assert ("stages_us" in run) == (sent["stage_clock"] != "none")
    assert sent["runs"][1]["deviation"] == far.deviation  # sent as it is: the server judges


@pytest.mark.slow
def test_a_volume_that_webgpu_cannot_hold_fails_and_the_session_goes_on(pack: Pack) -> None:
    devices = list_devices("webgpu")
    if not devices:
        pytest.skip("no device over webgpu here")
    document = room.manifest(pack)
    document["configurations"][1]["parameters"]["volume_resolution"] = 512
    asked = Manifest.parse(document)

    done = measure(
        pack._chunks.folder, asked, ("default", "best"), devices[0], references=room.references(asked)
    )

    assert [run.status for run in done.runs] == ["ok", "failed"]
    assert "volume_resolution=512 needs one buffer of 512 MiB" in str(done.runs[1].failure)
    assert "at most 128 MiB" in str(done.runs[1].failure)
