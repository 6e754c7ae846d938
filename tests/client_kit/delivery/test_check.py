"""`check`: other clients' payloads against a real server's dry run."""

import json
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
from tests.client_kit.commands import Terminal
from tests.client_kit.published import VERSION, publish
from tests.client_kit.scripted import Reply, Request, Serve, accepting, always, problem


@pytest.fixture
def asked(settings: Any, pack: Pack, db: None) -> Manifest:
    manifest = room.manifest(pack, front_version=f"kfusion-{VERSION}")
    publish(settings, pack, manifest["protocol"], manifest["configurations"])
    return Manifest.parse(manifest)


def written(folder: Path, name: str, payload: Any) -> str:
    path = folder / name
    path.write_text(json.dumps(payload))
    return str(path)


def test_a_payload_that_would_be_taken_is_said_to_be_and_leaves_nothing(
    live_server: Any, asked: Manifest, tmp_path: Path, terminal: Terminal
) -> None:
    good = written(tmp_path, "good.json", canned.payload(asked))

    code, out, error = terminal("check", good, "--server", live_server.url)

    assert code == 0, error
    assert out.splitlines() == [
        f"{good}: 4 of 4 runs would be accepted",
        "  default: valid",
        "  best: valid",
    ]
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
    assert lines[2] == "  default: valid"
    assert lines[3].startswith("  best: suspect (incomplete_pairs: a repeat of the configuration or of")
    assert lines[4].startswith(f"{files[1]}: refused: device.serial_number could identify a person")


def test_a_state_that_does_not_count_has_its_reason_in_each_session(
    live_server: Any, asked: Manifest, tmp_path: Path, terminal: Terminal
) -> None:
    both = canned.payload(asked)
    both["sessions"] += canned.payload(asked, seed=1)["sessions"]
    first, second = both["sessions"]
    for run in second["runs"]:
        run |= {"ate_max": 0.021, "ate_mean": 0.02, "ate_rmse": 0.0205, "deviation": 0.021}
    first["runs"] = [first["runs"][0], *first["runs"][3:]]

    code, out, _ = terminal("check", written(tmp_path, "both.json", both), "--server", live_server.url)

    assert code == 0
    lines = out.splitlines()
    assert lines[1] == f"  default of {first['id']}: valid"
    assert [line.split(": ")[:2] for line in lines[2:]] == [
        [f"  {name} of {second['id']}", "invalid (deviation_above_band"] for name in ("default", "best")
    ]


def test_errors_of_positions_that_were_not_rotated_are_named(
    live_server: Any, asked: Manifest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = canned.payload(asked)
    for run in wrong["sessions"][0]["runs"]:
        run |= {"ate_max": 0.0482, "deviation": 0.0}

    path = written(tmp_path, "wrong.json", wrong)
    assert command_line.main(["check", path, "--server", live_server.url]) == 1

    out = capsys.readouterr().out
    assert "refused: ate_max is 0.0482 m, that of the reference trajectory 0 m" in out
    assert "(error_contradicts_deviation)" in out


@pytest.mark.parametrize(("file", "words"), [("no.json", "is not JSON"), ("absent.json", "cannot be read")])
def test_a_file_without_a_payload_is_a_usage_error(
    file: str, words: str, tmp_path: Path, terminal: Terminal
) -> None:
    (tmp_path / "no.json").write_text("{")

    code, _, error = terminal("check", str(tmp_path / file), "--server", "http://127.0.0.1:1")

    assert (code, words in error) == (2, True)


@pytest.mark.slow
def test_the_error_is_printed_although_the_installation_cannot_be_erased_after_it(
    serve: Serve, tmp_path: Path, terminal: Terminal
) -> None:
    def answer(request: Request) -> Reply:
        if request.path.endswith("/enrol"):
            return accepting(request)
        what = "erasing" if request.method == "DELETE" else "judging"
        return problem(503, "busy", f"no {what} now")

    server = serve(always("/manifest", Reply(200, manifests.manifest()), answer))
    good = written(tmp_path, "good.json", canned.payload(Manifest.parse(manifests.manifest())))

    code, _, error = terminal("check", good, "--server", server.url)

    assert (code, "no judging now" in error) == (3, True)
