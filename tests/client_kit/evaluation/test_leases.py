"""Serving as a reference device: what a machine does with leases, good and bad ones."""

import json
from pathlib import Path
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit import evaluation
from client_kit.errors import CannotMeasureError, UsageError
from slam.isolated import CannotMeasureHereError, MeasurementError
from tests.client_kit import room
from tests.client_kit.commands import Terminal
from tests.client_kit.evaluation.lab import MEASURED, Lab, failing
from tests.client_kit.scripted import Reply, problem


def test_a_lease_is_measured_and_its_result_sent(lab: Lab, measured: list[Any]) -> None:
    lab.left = 2

    lab.serve()

    first, second = measured
    assert (first["system"], first["configuration"]) == ("kfusion", {"volume_resolution": 64})
    assert (first["frames"], first["timeout"]) == (11, 900)
    assert (first["device"], first["backend"]) == ("Board GPU (a platform, 1, driver 1)", "opencl")
    (folder,) = first["packs"]
    assert json.loads((folder / "pack.json").read_text())["sha256"] == lab.packs[0].sha256
    assert (first["perturbation"], first["stop_above"]) == (None, ())
    assert lab.states() == ["done", "done"]
    assert lab.results[0]["objectives"] == MEASURED.objectives
    assert lab.results[0]["configuration"] == {"volume_resolution": 64}
    chunks = [path for path in lab.server.paths() if "/sequences/" in path]
    assert len(chunks) == len(set(chunks))  # downloaded once
    assert first["packs"] == second["packs"]


def test_all_sequences_of_a_lease_are_downloaded_and_measured_and_their_parts_sent(
    lab: Lab, tmp_path: Path, measured: list[Any]
) -> None:
    other = room.write(tmp_path / "other", name="other")
    lab.packs.append(other)
    sequences = [lab.sequence, room.manifest(other)["sequence"]]
    lab.more = {"sequences": sequences, "perturbation": 3, "stop_above": [{"ate_max": 0.05}]}
    lab.more |= {"stop_after": 2, "learned_on": 1}

    said = lab.serve()

    [call] = measured
    names = [json.loads((folder / "pack.json").read_text())["name"] for folder in call["packs"]]
    assert names == ["room", "other"]
    assert (call["perturbation"], call["stop_above"], call["stop_after"]) == (3, ({"ate_max": 0.05},), 2)
    assert call["learned_on"] == 1
    asked = next(request.body for request in lab.server.requests if request.path.endswith("/leases"))
    assert json.loads(asked)["lease_version"] == 2
    assert lab.results[0]["parts"] == [
        {"sequence": "room", "lost": 1, "stopped_at": None, "objectives": {"runtime": 0.02, "ate_max": 0.01}}
    ]
    assert "at least 1.00 cm over 1 of 2 sequences" in said


@pytest.mark.parametrize(
    "more",
    [
        {"sequences": [{"name": "room"}]},
        {"sequences": "room"},
        {"perturbation": "much"},
        {"stop_above": "far"},
        {"stop_above": [{"ate_max": "far"}]},
    ],
)
def test_a_lease_with_sequences_that_cannot_be_read_is_given_back(
    more: dict[str, Any], lab: Lab, measured: list[Any]
) -> None:
    lab.more = more

    lab.serve()

    assert (lab.states(), measured) == (["returned"], [])
    assert "the lease cannot be read" in lab.results[0]["error"]


def test_a_lease_that_cannot_be_read_is_given_back_and_ends_nothing(lab: Lab, measured: list[Any]) -> None:
    lab.left, lab.unreadable = 2, 1

    said = lab.serve()

    assert lab.states() == ["done", "returned"]
    assert "the lease cannot be read" in lab.results[1]["error"]
    assert "the lease cannot be read" in said
    assert evaluation.LONGEST_PAUSE_SECONDS in lab.pauses


def test_a_server_that_wants_a_newer_client_is_asked_again_later(lab: Lab, measured: list[Any]) -> None:
    lab.refusals = [problem(409, "client_outdated", "this client cannot: update it")]

    assert "this client cannot: update it" in lab.serve()
    assert lab.states() == ["done"]


@pytest.mark.parametrize("backend", ["opencl", "webgpu"])
def test_the_backend_that_the_lease_names_measures(
    backend: str, lab: Lab, measured: list[Any], choices: list[Any]
) -> None:
    lab.more = {"backend": backend}

    lab.serve()

    assert choices == [("GPU", (backend,))]
    assert [call["backend"] for call in measured] == [backend]


@pytest.mark.parametrize(("wanted", "other"), [("opencl", "webgpu"), ("webgpu", "opencl")])
def test_a_lease_of_another_backend_than_is_wanted_is_given_back_with_both(
    wanted: str, other: str, lab: Lab, measured: list[Any], choices: list[Any]
) -> None:
    lab.more = {"backend": wanted}
    lab.serve(backend=wanted)
    lab.left, lab.more = 1, {"backend": other}

    with pytest.raises(CannotMeasureError) as ended:
        lab.serve(backend=wanted)

    reason = f"--backend {wanted}: the server has board measure over {other}"
    assert (str(ended.value), ended.value.exit_code) == (reason, 3)
    assert [(result["status"], result.get("error")) for result in lab.results] == [
        ("done", None),
        ("returned", reason),
    ]
    assert choices == [("GPU", (wanted,))]
    assert [call["backend"] for call in measured] == [wanted]


def test_a_failure_is_reported_with_its_reason(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, MeasurementError("killed by SIGSEGV"))

    lab.serve()

    [result] = lab.results
    assert (result["status"], result["error"]) == ("failed", "killed by SIGSEGV")


@pytest.mark.parametrize("downloads", [False, True])
def test_a_lease_that_is_gone_ends_its_download_or_measurement(
    downloads: bool, lab: Lab, measured: list[Any]
) -> None:
    lab.heartbeat = problem(410, "lease_gone", "taken over")
    if downloads:
        lab.heartbeat_seconds = 0.0  # each part of a download is long

    assert "the lease is gone" in lab.serve()
    assert (len(measured), lab.results) == (0 if downloads else 1, [])


def test_a_machine_that_cannot_measure_gives_back_with_the_reason_and_ends(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, CannotMeasureHereError("no OpenCL device here"))
    lab.left = 2

    with pytest.raises(CannotMeasureError, match="no OpenCL device here") as ended:
        lab.serve()

    assert ended.value.exit_code == 3
    assert lab.results == [{"status": "returned", "error": "no OpenCL device here"}]


@pytest.mark.parametrize(
    "refusal",
    [problem(401, "token_invalid", "ask for a new one"), problem(403, "another_device", "belongs to tv")],
)
def test_a_token_that_does_not_open_this_device_is_a_usage_error(refusal: Reply, lab: Lab) -> None:
    lab.refusals = [refusal]

    with pytest.raises(UsageError, match=f"{refusal.document['detail']}.*{refusal.document['code']}"):
        lab.serve()


def test_a_missing_token_is_an_error_that_names_its_variable(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(command_line.TOKEN_VARIABLE, raising=False)

    code, _, error = terminal("evaluate", "--server", "http://127.0.0.1:1", "--device", "board")

    assert (code, command_line.TOKEN_VARIABLE in error) == (2, True)
