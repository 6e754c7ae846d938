"""Choosing a configuration for this device from the published front and its own measurements."""

import json
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit import __main__ as command_line
from client_kit import adaptation
from client_kit.choice import (
    MEASURED,
    PREDICTED,
    SCALED,
    choose,
    device_of,
    of_one_device,
    points,
    predictions,
)
from client_kit.delivery.manifest import Manifest
from client_kit.delivery.server import NotFrontrunnerError
from client_kit.delivery.spool import Spool
from client_kit.device import description, selection
from client_kit.errors import CannotMeasureError
from client_kit.home import Home
from slam.devices.choice import choose_device
from tests.builders import manifests
from tests.client_kit import room
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem
from tests.shipped import LIVING_ROOM

FRONT = Manifest.parse(manifests.manifest())


def run(configuration: str, milliseconds: float, ate_max: float | None, **changes: Any) -> dict[str, Any]:
    # The frames before the first counted one are slow, and must not count.
    times = [10**6] * 4 + [round(1000 * milliseconds)] * 8
    return {
        "configuration": configuration,
        "status": "ok",
        "frame_us": times,
        "ate_max": ate_max,
        **changes,
    }


def session(*runs: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return manifests.payload(runs=list(runs), **changes)


def test_what_was_measured_here_counts_and_the_rest_is_scaled() -> None:
    candidates = points(
        FRONT, [session(run("default", 190, 0.011), run("default", 210, 0.012), run("best", 40, 0.03))]
    )

    assert {point.name: (round(point.runtime, 9), point.ate_max, point.source) for point in candidates} == {
        "default": (0.2, 0.012, MEASURED),
        "best": (0.04, 0.03, MEASURED),
        # Twice the reference's 50 ms, as this device's default takes twice the reference's 100 ms.
        "fine": (0.1, 0.008, SCALED),
    }


def test_what_failed_here_is_never_chosen() -> None:
    failed = run("fine", 1, None, status="failed", frame_us=[])

    candidates = points(FRONT, [session(run("default", 200, 0.011), failed, run("best", 40, None))])

    assert [point.name for point in candidates] == ["default"]


@pytest.mark.parametrize(("deviation", "counts"), [(0.0029, True), (0.0031, False)])
def test_what_leaves_its_band_here_is_never_chosen(deviation: float, counts: bool) -> None:
    runs = [run("default", 200, 0.011, deviation=0.001), run("best", 40, 0.03, deviation=deviation)]
    foreign = run("of another server", 1, 0.01, deviation=9.0)

    sources = {point.name: point.source for point in points(FRONT, [session(*runs, foreign)])}

    assert sources == {"default": MEASURED, "fine": SCALED} | ({"best": MEASURED} if counts else {})


def test_measurements_of_another_front_are_disregarded() -> None:
    assert points(FRONT, [session(run("default", 200, 0.011), front_version="0")]) == []


def recommended(name: str, parameters: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A row of the front in a server's recommendation."""
    row = {
        "configuration": name,
        "parameters": parameters,
        "ate_max": 0.02,
        "ratio": 4.0,
        "low": 2.0,
        "high": 5.0,
    }
    return row | {"state": "predicted"} | changes


def recommendation(*rows: dict[str, Any]) -> dict[str, Any]:
    best = {"ratio": 4.0, "low": 2.0, "high": 5.0}
    return {"configuration": "fine", "parameters": {"mu": 0.2}, "predicted": best, "front": list(rows)}


def test_the_crowds_predictions_count_for_what_was_not_measured_here() -> None:
    crowd = predictions(
        recommendation(
            recommended("best", {"mu": 0.4}, ratio=9.0),
            recommended("fine", {"mu": 0.2}, ate_max=None),
            recommended("probe", {"mu": 0.3}, low=None, high=None),
        )
    )

    candidates = {
        point.name: point
        for point in points(FRONT, [session(run("default", 200, 0.011), run("best", 40, 0.03))], crowd)
    }

    best, fine, probe = candidates["best"], candidates["fine"], candidates["probe"]
    assert (best.runtime, best.source, best.low) == (0.04, MEASURED, None)
    assert (fine.runtime, fine.low, fine.high, fine.ate_max) == (0.05, 0.04, 0.1, 0.008)
    assert (probe.runtime, probe.low, probe.high, probe.ate_max) == (0.05, None, None, 0.02)
    assert (fine.source, probe.source, probe.parameters) == (PREDICTED, PREDICTED, {"mu": 0.3})


def test_a_prediction_for_other_parameters_or_without_a_default_here_does_not_count() -> None:
    other = predictions(recommendation(recommended("fine", {"mu": 0.9})))

    [fine] = [
        one for one in points(FRONT, [session(run("default", 200, 0.011))], other) if one.name == "fine"
    ]
    assert (fine.source, fine.parameters) == (SCALED, {"mu": 0.2})
    assert points(FRONT, [], predictions(recommendation(recommended("fine", {"mu": 0.2})))) == []


def test_what_failed_here_is_not_chosen_for_its_prediction() -> None:
    crowd = predictions(recommendation(recommended("fine", {"mu": 0.2})))
    failed = run("fine", 1, None, status="failed", frame_us=[])

    candidates = points(FRONT, [session(run("default", 200, 0.011), failed)], crowd)

    assert "fine" not in [point.name for point in candidates]


@pytest.mark.parametrize(
    "answer",
    [{}, {"front": None}, {"front": [{}]}, {"front": [recommended("fine", {}, ratio=0)]},
     {"front": [recommended("fine", {}, low="low")]}, {"front": [recommended("fine", {}, ratio=None)]}],
)  # fmt: skip
def test_a_recommendation_that_is_not_understood_is_refused(answer: dict[str, Any]) -> None:
    with pytest.raises(NotFrontrunnerError, match="recommendation is malformed"):
        predictions(answer)


@pytest.fixture
def chosen(
    home: Home,
    spool: Spool,
    serve: Callable[..., ScriptedServer],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[..., tuple[str, list[Request]]]:
    """What `choose` prints after a session of the default, by how the server answers, and what it asks."""
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))

    def choosing(answer: Reply, *options: str, others: tuple[str, ...] = ()) -> tuple[str, list[Request]]:
        server = serve(lambda _: answer)
        home.write("manifest-1.json", {"server": server.url, "manifest": manifests.manifest()})
        installation = {"installation_id": "me", "token": "secret", "erase": False}
        home.write("installations.json", {server.url: installation})
        for name in (*others, "this device"):
            measured = session(run("default", 200, 0.011))
            spool.put(server.url, measured | {"device": {"opencl_device": name}})
        assert command_line.main(["choose", *options]) == 0
        return capsys.readouterr().out, server.requests

    return choosing  # fmt: skip


def test_choose_asks_the_server_and_shows_the_interval(chosen: Callable[..., Any]) -> None:
    answer = Reply(200, recommendation(recommended("fine", {"mu": 0.2}), recommended("best", {"mu": 0.4})))

    out, [asked] = chosen(answer, "--max-ate", "0.03", "--max-ms", "90")

    assert asked.path == "/api/v1/recommendation?application=kfusion"
    assert asked.headers["authorization"] == "Bearer secret"
    assert "50.00 ms a frame (predicted by the crowd, 95 % interval 40.00 to 100.00 ms)" in out


def test_the_json_has_the_interval_in_seconds(chosen: Callable[..., Any]) -> None:
    out, _ = chosen(Reply(200, recommendation(recommended("best", {"mu": 0.4}))), "--json")

    choice = json.loads(out)
    assert (choice["runtime"], choice["low"], choice["high"]) == (0.05, 0.04, 0.1)
    assert (choice["configuration"], choice["source"]) == ("best", PREDICTED)


@pytest.mark.parametrize(
    "answer",
    [problem(404, "not_found", "nothing is known"), problem(503, "busy", "later"), Reply(200, {"front": 7}),
     problem(426, "outdated", "update"), Reply(200, raw=b"a hotel's log-in page")],
)  # fmt: skip
def test_without_a_recommendation_the_reference_is_scaled(answer: Reply, chosen: Callable[..., Any]) -> None:
    out, requests = chosen(answer, "--json")

    choice = json.loads(out)
    assert len(requests) == 1
    assert (choice["configuration"], choice["source"]) == ("best", SCALED)
    assert (choice["low"], choice["high"]) == (None, None)


def test_the_server_is_not_asked_about_another_device_than_the_last(chosen: Callable[..., Any]) -> None:
    answer = Reply(200, recommendation(recommended("best", {"mu": 0.4})))

    out, requests = chosen(answer, "--device", "older", "--json", others=("older",))

    assert requests == []
    assert json.loads(out)["source"] == SCALED


def test_the_fastest_within_the_error_is_chosen() -> None:
    candidates = points(FRONT, [session(run("default", 100, 0.010), run("best", 10, 0.040))])

    assert choose(candidates, 0.05).name == "best"
    assert choose(candidates, 0.02).name == "fine"


def test_with_a_time_limit_the_most_accurate_that_is_fast_enough_is_chosen() -> None:
    candidates = points(FRONT, [session(run("default", 100, 0.010), run("best", 10, 0.040))])

    assert choose(candidates, 0.05, 0.060).name == "fine"
    assert choose(candidates, 0.05, 0.033).name == "best"


def test_limits_that_nothing_keeps_name_the_nearest() -> None:
    candidates = points(FRONT, [session(run("default", 100, 0.010), run("best", 10, 0.040))])

    with pytest.raises(CannotMeasureError, match=r"ate_max within 0\.001: the best is 0\.008"):
        choose(candidates, 0.001)


def test_before_any_measurement_there_is_nothing_to_choose_by() -> None:
    with pytest.raises(CannotMeasureError, match="run the client once"):
        choose(points(FRONT, []), 0.05)


def test_only_the_device_that_was_measured_last_counts_unless_another_is_named() -> None:
    fast = session(run("default", 20, 0.01)) | {"device": {"opencl_device": "RTX 5090"}}
    slow = session(run("default", 200, 0.01)) | {"device": {"opencl_device": "Mali-T628"}}

    assert of_one_device([fast, slow, fast, slow]) == [slow, slow]
    assert of_one_device([fast, slow], "rtx") == [fast]
    assert of_one_device([fast, slow], "adreno") == []
    assert of_one_device([]) == []


def test_what_fails_half_the_time_here_is_never_chosen() -> None:
    failed = run("best", 1, None, status="failed", frame_us=[])
    default = run("default", 200, 0.011)

    half = points(FRONT, [session(default, run("best", 40, 0.03), failed)])
    rarely = points(FRONT, [session(default, run("best", 40, 0.03), run("best", 40, 0.03), failed)])

    assert "best" not in [point.name for point in half]
    assert "best" in [point.name for point in rarely]


def test_the_choice_is_run_on_the_device_that_it_was_made_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def present(name: str, platform: str) -> SimpleNamespace:
        handle = SimpleNamespace(
            name=name,
            vendor="",
            driver_version="1",
            version="3",
            platform=SimpleNamespace(name=platform, version="3"),
        )
        return SimpleNamespace(backend="opencl", handle=handle)

    webgpu = SimpleNamespace(
        backend="webgpu", name="a CPU", platform="Vulkan", version="wgpu-py 1", driver="Mesa"
    )
    wasm = SimpleNamespace(backend="wasm")
    devices = [present("a  CPU", "Intel"), present("a  CPU", "PoCL"), webgpu, wasm]
    monkeypatch.setattr(selection, "present", lambda: devices)

    assert adaptation._present(("a CPU", "PoCL")) is devices[1]
    assert adaptation._present(("a CPU", "Vulkan")) is webgpu
    assert adaptation._present(device_of({"device": description.identify()})) is wasm
    with pytest.raises(CannotMeasureError, match=r"Mali .* is not here any more"):
        adaptation._present(("Mali", "ARM"))


@pytest.mark.slow
def test_the_choice_runs_over_the_shipped_sequence(
    home: Home,
    spool: Spool,
    closed_port: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    server = f"http://127.0.0.1:{closed_port}"
    configurations = [
        manifests.configuration(name, parameters) for name, parameters in room.CONFIGURATIONS.items()
    ]
    front = manifests.manifest(configurations=configurations)
    home.write("manifest-1.json", {"server": server, "manifest": front})
    here = description.opencl_identity(choose_device().handle)
    measured = session(run("default", 200, 0.011), run("best", 40, 0.03))
    spool.put(server, measured | {"device": here})
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))

    code = command_line.main(["choose", "--max-ate", "0.05", "--run", str(LIVING_ROOM), "--frames", "12"])

    output = capsys.readouterr().out
    assert code == 0
    assert "best of front kfusion 1" in output
    assert "volume_resolution = 64" in output
    assert re.search(r"living-room, 12 frames: [\d.]+ ms a frame, [\d.]+ frames a second", output)
    assert re.search(r"largest trajectory error [\d.]+ cm, within the limit of 5 cm", output)
