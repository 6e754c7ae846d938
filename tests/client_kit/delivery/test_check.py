"""`check`: other clients' payloads against a real server's dry run."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit.delivery.manifest import Manifest
from crowd.devices.models import Installation
from crowd.results.models import MeasurementSession
from slam.datasets.formats.pack import Pack
from tests.builders import manifests
from tests.client_kit import canned, room
from tests.client_kit.published import VERSION, publish
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem


@pytest.fixture(scope="module")
def pack(tmp_path_factory: pytest.TempPathFactory) -> Pack:
    return room.write(tmp_path_factory.mktemp("sequences") / "room")


@pytest.fixture
def asked(settings: Any, pack: Pack, db: None) -> Manifest:
    manifest = room.manifest(pack, front_version=f"kfusion-{VERSION}")
    publish(settings, pack, manifest["protocol"], manifest["configurations"])
    return Manifest.parse(manifest)


@pytest.fixture(autouse=True)
def own_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FRONTRUNNER_HOME", str(tmp_path / "home"))


def written(folder: Path, name: str, payload: Any) -> str:
    path = folder / name
    path.write_text(json.dumps(payload))
    return str(path)


def test_a_payload_that_would_be_taken_is_said_to_be_and_leaves_nothing(
    live_server: Any, asked: Manifest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = written(tmp_path, "good.json", canned.payload(asked))

    code = command_line.main(["check", good, "--server", live_server.url])

    assert code == 0, capsys.readouterr().err
    assert capsys.readouterr().out == f"{good}: 4 of 4 runs would be accepted\n"
    assert MeasurementSession.objects.count() == Installation.objects.count() == 0


def test_errors_are_listed_run_by_run_and_file_by_file(
    live_server: Any, asked: Manifest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short, foreign = canned.payload(asked), canned.payload(asked)
    short["sessions"][0]["runs"][2]["frame_us"].pop()
    foreign["device"]["serial_number"] = "1"
    files = [written(tmp_path, "short.json", short), written(tmp_path, "foreign.json", foreign)]

    code = command_line.main(["check", *files, "--server", live_server.url])

    lines = capsys.readouterr().out.splitlines()
    assert code == 1
    assert lines[0] == f"{files[0]}: 3 of 4 runs would be accepted"
    assert "frame_count at sessions[0].runs[2].frame_us" in lines[1]
    assert lines[2].startswith(f"{files[1]}: refused: device.serial_number could identify a person")


def test_a_file_that_is_none_is_a_usage_error(
    live_server: Any, asked: Manifest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "no.json").write_text("{")

    for file, words in {"no.json": "is not JSON", "absent.json": "cannot be read"}.items():
        assert command_line.main(["check", str(tmp_path / file), "--server", live_server.url]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.slow
def test_the_error_is_printed_although_the_installation_cannot_be_erased_after_it(
    serve: Callable[..., ScriptedServer], asked: Manifest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def answer(request: Request) -> Reply:
        if "/manifest" in request.path:
            return Reply(200, manifests.manifest())
        if request.path.endswith("/enrol"):
            return Reply(201, {"installation_id": "me", "token": "secret"})
        what = "erasing" if request.method == "DELETE" else "judging"
        return problem(503, "busy", f"no {what} now")

    good = written(tmp_path, "good.json", canned.payload(asked))

    assert command_line.main(["check", good, "--server", serve(answer).url]) == 3
    assert "no judging now" in capsys.readouterr().err
