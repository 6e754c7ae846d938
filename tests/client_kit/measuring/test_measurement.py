"""Measuring a session with the real pipeline, and what is made of its runs."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from client_kit.delivery.manifest import Manifest, version_numbers
from client_kit.errors import CannotMeasureError
from client_kit.measuring.measurement import measure
from client_kit.measuring.session import payload
from slam.datasets.formats.pack import Pack
from slam.devices.choice import choose_device, list_devices
from slam.devices.device import BACKENDS
from tests.client_kit import canned, room
from tests.client_kit.observing import Calling
from wire.session import Sample


@pytest.mark.slow
def test_a_session_runs_its_plan_over_all_frames(watched: room.Watched) -> None:
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
        assert run.tracked == [None] * 4 + [True] * (room.FRAMES - 4)
        assert run.ate_max is not None
        assert run.ate_max < 0.05
    assert [frame[:3] for frame in frames[:2]] == [("warm-up, default", 1, 2), ("warm-up, default", 2, 2)]
    assert frames[-1] == ("default, run 5 of 5", room.FRAMES, room.FRAMES, 0.0)
    assert all(left is not None and left >= 0 for *_, left in frames)
    # The same configuration computes the same trajectory.
    deviations = [run.deviation for run in runs]
    assert deviations[0] == deviations[4] != deviations[1] == deviations[3]


@pytest.mark.slow
def test_a_configuration_that_fails_here_is_recorded_and_the_others_go_on(watched: room.Watched) -> None:
    failed = watched.session.runs[2]

    assert failed.status == "failed"
    assert "compute_size_ratio=7" in (failed.failure or "")
    document = payload(watched.session, watched.asked, {})["sessions"][0]["runs"][2]
    assert (document["frame_us"], "ate_max" in document) == ([], False)
    assert watched.session.speedup("indivisible", watched.asked) is None


@pytest.mark.slow
def test_the_payload_is_what_the_interface_says(watched: room.Watched) -> None:
    document = payload(watched.session, watched.asked, {"model": "Pixel 8", "cpu": None})

    sent = json.loads(json.dumps(document, allow_nan=False))

    assert set(sent) == {"schema_version", "app_version", "consent_version", "device", "sessions"}
    # Since 0.2.0 a frame of KinectFusion is taken with one synchronisation: its times are others.
    assert version_numbers(sent["app_version"]) >= (0, 2, 0)
    assert sent["device"] == {"model": "Pixel 8", "cpu": None}
    [session] = sent["sessions"]
    described = {"application": "kfusion", "front_version": "1", "protocol_version": 2, "backend": "opencl"}
    assert session | described == session
    assert session["started_at"].endswith("Z")
    assert set(session["samples"][0]) == set(Sample.__struct_fields__)
    run = session["runs"][0]
    assert set(run["stages_us"]) == set(canned.STAGES)
    assert all(len(series) == room.FRAMES for series in run["stages_us"].values())
    assert all(type(time) is int for time in run["frame_us"])


@pytest.mark.slow
def test_where_the_device_is_gone_nothing_is_measured(pack: Pack) -> None:
    asked, gone = Manifest.parse(room.manifest(pack)), replace(choose_device(), name="abacus")

    with pytest.raises(CannotMeasureError, match="no OpenCL device matches 'abacus"):
        measure(room.task(pack, asked, asked.plan()), gone, Calling())


@pytest.mark.slow
def test_a_sequence_that_cannot_serve_is_not_blamed_on_a_configuration(tmp_path: Path) -> None:
    pack = room.write(tmp_path / "room")
    document = room.manifest(pack)
    last = tmp_path / "room" / "chunks" / pack.manifest["chunks"][-1]["sha256"]

    def refused(words: str, **protocol: int) -> None:
        asked = Manifest.parse({**document, "protocol": document["protocol"] | protocol})
        with pytest.raises(CannotMeasureError, match=words):
            measure(room.task(pack, asked, ("default",)), choose_device(), Calling())

    refused("12 frames, the protocol measures 100", frames=100)
    last.write_bytes(last.read_bytes()[:-1])
    refused("damaged")
    (tmp_path / "room" / "pack.json").write_text("{")
    refused(r"pack\.json")


LARGE = {"volume_resolution": 512}  # more than WebGPU holds in one buffer


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_each_run_is_compared_with_its_reference_and_what_does_not_fit_fails(
    backend: str, pack: Pack
) -> None:
    devices = list_devices(backend)
    if not devices:
        pytest.skip(f"no device over {backend} here")
    document = room.manifest(pack, far=("best",))
    indivisible = document["configurations"][2]
    if backend == "webgpu":
        indivisible["parameters"] = LARGE
    asked = Manifest.parse(document)
    plan = ("default", "best", "indivisible", "best", "default")

    done, _ = measure(room.task(pack, asked, plan), devices[0], Calling())

    assert [(run.configuration, run.status) for run in done.runs] == [
        ("default", "ok"), ("best", "ok"), ("indivisible", "failed"), ("best", "ok"), ("default", "ok"),
    ]  # fmt: skip
    near, far, failed, *_ = done.runs
    if backend == "webgpu":
        assert "volume_resolution=512 needs one buffer of 512 MiB" in str(failed.failure)
        assert "at most 128 MiB" in str(failed.failure)
    assert near.deviation is not None
    assert far.deviation is not None
    assert 0 < near.deviation < room.BAND < far.deviation < 0.15
    assert not near.deviates(asked)
    assert done.speedup("best", asked) is None
    [sent] = json.loads(json.dumps(payload(done, asked, {}), allow_nan=False))["sessions"]
    assert (sent["protocol_version"], sent["backend"]) == (2, backend)
    assert 0 < sent["empty_frame_us"] < 60e6
    clocks = {"opencl": ("device", "none"), "webgpu": ("none",), "wasm": ("wall",)}
    assert sent["stage_clock"] in clocks[backend]
    assert sent.get("threads") == (devices[0].compute_units if backend == "wasm" else None)
    finished = [run for run in sent["runs"] if run["status"] == "ok"]
    assert all(("stages_us" in run) == (sent["stage_clock"] != "none") for run in finished)
    assert sent["runs"][1]["deviation"] == far.deviation  # sent as it is: the server judges
