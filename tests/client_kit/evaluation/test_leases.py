"""Serving as a reference device: what a machine does with leases, good and bad ones."""

import io
import json
from pathlib import Path
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit import evaluation
from client_kit.console import Console
from client_kit.delivery.server import Server
from client_kit.errors import CannotMeasureError, UsageError
from client_kit.evaluation import serve
from client_kit.home import Home
from slam.datasets.formats.pack import Pack
from slam.isolated import CannotMeasureHereError, Measurement, MeasurementError
from tests.client_kit import room
from tests.client_kit.evaluation.lab import MEASURED, Lab
from tests.client_kit.scripted import Reply, problem


def test_a_lease_is_measured_and_its_result_sent(pack: Pack, serve_lab: Any, measured: list[Any]) -> None:
    lab = Lab(pack, leases=2)

    serve_lab(lab)

    (first, second), results = measured, lab.results
    assert (first["system"], first["configuration"]) == ("kfusion", {"volume_resolution": 64})
    assert (first["frames"], first["timeout"]) == (11, 900)
    assert (first["device"], first["backend"]) == ("Board GPU (a platform, 1, driver 1)", "opencl")
    (folder,) = first["packs"]
    assert json.loads((folder / "pack.json").read_text())["sha256"] == pack.sha256
    assert (first["perturbation"], first["stop_above"]) == (None, ())
    assert [result["status"] for result in results] == ["done", "done"]
    assert results[0]["objectives"] == MEASURED.objectives
    assert results[0]["configuration"] == {"volume_resolution": 64}
    chunks = [path for path in lab.server.paths() if "/sequences/" in path]
    assert len(chunks) == len(set(chunks))  # downloaded once
    assert first["packs"] == second["packs"]


def several(pack: Pack, folder: Path) -> tuple[Lab, Pack]:
    """A lab whose lease names two sequences, and the second one."""
    other = room.write(folder / "other", name="other")
    lab = Lab(pack)
    lab.packs.append(other)
    sequences = [lab.sequence, room.manifest(other)["sequence"]]
    lab.more = {"sequences": sequences, "perturbation": 3, "stop_above": [{"ate_max": 0.05}]}
    lab.more |= {"stop_after": 2, "learned_on": 1}
    return lab, other


def test_all_sequences_of_a_lease_are_downloaded_and_measured_as_it_says(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any]
) -> None:
    lab, other = several(pack, tmp_path)

    serve_lab(lab)

    [call] = measured
    names = [json.loads((folder / "pack.json").read_text())["name"] for folder in call["packs"]]
    assert names == ["room", "other"]
    assert (call["perturbation"], call["stop_above"], call["stop_after"]) == (3, ({"ate_max": 0.05},), 2)
    assert call["learned_on"] == 1
    asked = json.loads(
        next(request.body for request in lab.server.requests if request.path.endswith("/leases"))
    )
    assert asked["lease_version"] == 2
    assert other.sha256 != pack.sha256


def test_the_parts_of_a_measurement_are_sent(
    pack: Pack, tmp_path: Path, serve_lab: Any, measured: list[Any]
) -> None:
    lab, _ = several(pack, tmp_path)

    said, _ = serve_lab(lab)

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
    more: dict[str, Any], pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.more = more

    serve_lab(lab)

    assert [result["status"] for result in lab.results] == ["returned"]
    assert "the lease cannot be read" in lab.results[0]["error"]
    assert not measured


def test_a_server_that_wants_a_newer_client_is_asked_again_later(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack)
    lab.refusals = [problem(409, "client_outdated", "this client cannot: update it")]

    said, _ = serve_lab(lab)

    assert "this client cannot: update it" in said
    assert [result["status"] for result in lab.results] == ["done"]


@pytest.mark.parametrize(
    ("named", "measures"),
    [({"backend": "webgpu"}, "webgpu"), ({"backend": "opencl"}, "opencl")],
)
def test_the_backend_that_the_lease_names_measures(
    named: dict[str, str],
    measures: str,
    pack: Pack,
    serve_lab: Any,
    measured: list[Any],
    choices: list[Any],
) -> None:
    lab = Lab(pack)
    lab.more = named

    serve_lab(lab)

    assert choices == [("GPU", (measures,))]
    assert [call["backend"] for call in measured] == [measures]


@pytest.mark.parametrize("wanted", ["opencl", "webgpu"])
def test_a_lease_of_another_backend_than_is_wanted_is_given_back_with_both(
    wanted: str, pack: Pack, home: Home, measured: list[Any], choices: list[Any]
) -> None:
    lab, other = Lab(pack), "webgpu" if wanted == "opencl" else "opencl"

    def serve_lease(backend: str) -> None:
        lab.left, lab.more = 1, {"backend": backend}
        console = Console(io.StringIO())
        serve(Server(lab.server.url), "board", "secret", home, console, until_idle=True, backend=wanted)

    serve_lease(wanted)
    with pytest.raises(CannotMeasureError) as ended:
        serve_lease(other)
    lab.server.close()

    reason = f"--backend {wanted}: the server has board measure over {other}"
    assert (str(ended.value), ended.value.exit_code) == (reason, 3)
    assert [(result["status"], result.get("error")) for result in lab.results] == [
        ("done", None),
        ("returned", reason),
    ]
    assert choices == [("GPU", (wanted,))]
    assert [call["backend"] for call in measured] == [wanted]


def test_a_failure_is_reported_with_its_reason(
    pack: Pack, serve_lab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> Measurement:
        raise MeasurementError("killed by SIGSEGV")

    monkeypatch.setattr(evaluation.isolated, "measure", fail)
    lab = Lab(pack)

    serve_lab(lab)

    assert [(result["status"], result["error"]) for result in lab.results] == [
        ("failed", "killed by SIGSEGV")
    ]


def test_a_lease_that_is_gone_ends_its_measurement(pack: Pack, serve_lab: Any, measured: list[Any]) -> None:
    lab = Lab(pack)
    lab.heartbeat = problem(410, "lease_gone", "taken over")

    said, _ = serve_lab(lab)

    assert lab.results == []
    assert "the lease is gone" in said


def test_a_lease_that_cannot_be_read_is_given_back_and_ends_nothing(
    pack: Pack, serve_lab: Any, measured: list[Any]
) -> None:
    lab = Lab(pack, leases=2)
    lab.unreadable = 1

    said, pauses = serve_lab(lab)

    assert [result["status"] for result in lab.results] == ["done", "returned"]
    assert "the lease cannot be read" in lab.results[1]["error"]
    assert "the lease cannot be read" in said
    assert evaluation.LONGEST_PAUSE_SECONDS in pauses


def test_a_machine_that_cannot_measure_gives_back_with_the_reason_and_ends(
    pack: Pack, serve_lab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(*_: Any, **__: Any) -> Measurement:
        raise CannotMeasureHereError("no OpenCL device here")

    monkeypatch.setattr(evaluation.isolated, "measure", nothing)
    lab = Lab(pack, leases=2)

    with pytest.raises(CannotMeasureError, match="no OpenCL device here") as ended:
        serve_lab(lab)

    assert ended.value.exit_code == 3
    assert lab.results == [{"status": "returned", "error": "no OpenCL device here"}]


@pytest.mark.parametrize(
    "refusal",
    [problem(401, "token_invalid", "ask for a new one"), problem(403, "another_device", "belongs to tv")],
)
def test_a_token_that_does_not_open_this_device_is_a_usage_error(
    pack: Pack, serve_lab: Any, refusal: Reply
) -> None:
    lab = Lab(pack)
    lab.refusals = [refusal]
    with pytest.raises(UsageError, match=f"{refusal.document['detail']}.*{refusal.document['code']}"):
        serve_lab(lab)


def test_a_missing_token_is_an_error_that_names_its_variable(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FRONTRUNNER_HOME", str(tmp_path))
    monkeypatch.delenv(command_line.TOKEN_VARIABLE, raising=False)
    assert command_line.main(["evaluate", "--server", "http://127.0.0.1:1", "--device", "board"]) == 2
    assert command_line.TOKEN_VARIABLE in capsys.readouterr().err
