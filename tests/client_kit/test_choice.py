"""Choosing a configuration for this device from the published front and its own measurements."""

import json
import math
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

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
from tests.client_kit.commands import Terminal
from tests.client_kit.scripted import Reply, Request, Serve, problem
from tests.shipped import LIVING_ROOM

FRONT = Manifest.parse(manifests.manifest())


def run(configuration: str, milliseconds: float, ate_max: float | None, **changes: Any) -> dict[str, Any]:
    # The frames before the first counted one are slow, and must not count.
    times = [10**6] * 4 + [round(1000 * milliseconds)] * 8
    made = {"configuration": configuration, "status": "ok", "frame_us": times, "ate_max": ate_max}
    return made | changes


DEFAULT = run("default", 200, 0.011)
FAILED = {"status": "failed", "frame_us": []}


def session(*runs: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return manifests.payload(runs=list(runs), **changes)


def sources(*runs: dict[str, Any], crowd: tuple[Any, ...] = ()) -> dict[str, str]:
    """Where the times of each candidate come from, after a session of `runs`."""
    return {point.name: point.source for point in points(FRONT, [session(*runs)], crowd)}


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


@pytest.mark.parametrize(
    ("best", "chosen"),
    [
        ([run("best", 40, 0.03)], True),
        ([run("best", 40, None)], False),  # its trajectory is unknown
        ([run("best", 1, None, **FAILED)], False),
        ([run("best", 40, 0.03), run("best", 1, None, **FAILED)], False),  # it fails half the time
        ([run("best", 40, 0.03), run("best", 40, 0.03), run("best", 1, None, **FAILED)], True),
        ([run("best", 40, 0.03, deviation=0.0029)], True),
        ([run("best", 40, 0.03, deviation=0.0031)], False),  # it leaves its band
    ],
)
def test_what_fails_or_leaves_its_band_here_is_never_chosen(best: list[dict[str, Any]], chosen: bool) -> None:
    default = DEFAULT | {"deviation": 0.001}
    foreign = run("of another server", 1, 0.01, deviation=9.0)

    expected = {"default": MEASURED, "fine": SCALED} | ({"best": MEASURED} if chosen else {})
    assert sources(default, *best, foreign) == expected


def test_measurements_of_another_front_are_disregarded() -> None:
    assert points(FRONT, [session(DEFAULT, front_version="0")]) == []


INTERVAL = {"ratio": 4.0, "low": 2.0, "high": 5.0}


def recommended(name: str, parameters: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A row of the front in a server's recommendation."""
    row = {"configuration": name, "parameters": parameters, "ate_max": 0.02, "held_out_ate_max": None}
    row["state"] = "predicted"
    return row | INTERVAL | changes


def recommendation(*rows: dict[str, Any]) -> dict[str, Any]:
    return {
        "application": "kfusion",
        "front_version": "1",
        "about": "this device",
        "configuration": "fine",
        "parameters": {"mu": 0.2},
        "predicted": INTERVAL,
        "ate_max": 0.02,
        "held_out_ate_max": None,
        "sequences": {"learned_on": [], "held_out": []},
        "default_seconds": None,
        "basis": {"rung": "stages", "sessions": 1, "devices": 1, "nearest": []},
        "state": "predicted",
        "front": list(rows),
    }


def test_the_crowds_predictions_count_for_what_was_not_measured_here() -> None:
    crowd = predictions(
        recommendation(
            recommended("best", {"mu": 0.4}, ratio=9.0),
            recommended("fine", {"mu": 0.2}, ate_max=None),
            recommended("probe", {"mu": 0.3}),
        )
    )

    measured = session(DEFAULT, run("best", 40, 0.03))
    candidates = {point.name: point for point in points(FRONT, [measured], crowd)}

    best, fine, probe = candidates["best"], candidates["fine"], candidates["probe"]
    assert (best.runtime, best.source, best.low) == (0.04, MEASURED, None)
    assert (fine.runtime, fine.low, fine.high, fine.ate_max) == (0.05, 0.04, 0.1, 0.008)
    assert (probe.runtime, probe.low, probe.high, probe.ate_max) == (0.05, 0.04, 0.1, 0.02)
    assert (fine.source, probe.source, probe.parameters) == (PREDICTED, PREDICTED, {"mu": 0.3})


def test_predictions_count_only_for_the_same_parameters_beside_a_default_and_for_what_did_not_fail() -> None:
    fine = predictions(recommendation(recommended("fine", {"mu": 0.2})))
    other = predictions(recommendation(recommended("fine", {"mu": 0.9})))

    assert sources(DEFAULT, crowd=fine)["fine"] == PREDICTED
    assert sources(DEFAULT, crowd=other)["fine"] == SCALED
    assert points(FRONT, [], fine) == []
    assert "fine" not in sources(DEFAULT, run("fine", 1, None, **FAILED), crowd=fine)


@pytest.mark.parametrize(
    "answer",
    [
        {},
        recommendation() | {"front": None},
        recommendation({}),
        *(
            recommendation(recommended("fine", {}, **wrong))
            for wrong in ({"ratio": 0}, {"low": "low"}, {"ratio": None}, {"high": math.nan})
        ),
    ],
)
def test_a_recommendation_that_is_not_understood_is_refused(answer: dict[str, Any]) -> None:
    with pytest.raises(NotFrontrunnerError, match="recommendation is malformed"):
        predictions(answer)


Choosing = Callable[..., tuple[str, list[Request]]]


@pytest.fixture
def chosen(home: Home, spool: Spool, serve: Serve, terminal: Terminal) -> Choosing:
    """What `choose` prints after a session of the default, by how the server answers, and what it asks."""

    def choosing(answer: Reply, *options: str, others: tuple[str, ...] = ()) -> tuple[str, list[Request]]:
        server = serve(lambda _: answer)
        home.write("manifest-1.json", {"server": server.url, "manifest": manifests.manifest()})
        installation = {"server": server.url, "installation_id": "me", "token": "secret", "erase": False}
        home.write("installations.json", {server.url: [installation]})
        for name in (*others, "this device"):
            spool.put(server.url, session(DEFAULT) | {"device": {"opencl_device": name}})
        code, out, _ = terminal("choose", *options)
        assert code == 0
        return out, server.requests

    return choosing


def test_choose_asks_the_server_and_shows_the_interval(chosen: Choosing) -> None:
    answer = Reply(200, recommendation(recommended("fine", {"mu": 0.2}), recommended("best", {"mu": 0.4})))

    out, [asked] = chosen(answer, "--max-ate", "0.03", "--max-ms", "90")

    assert asked.path == "/api/v1/recommendation?application=kfusion"
    assert asked.headers["authorization"] == "Bearer secret"
    assert "50.00 ms a frame (predicted by the crowd, 95 % interval 40.00 to 100.00 ms)" in out


def test_the_json_has_the_interval_in_seconds(chosen: Choosing) -> None:
    out, _ = chosen(Reply(200, recommendation(recommended("best", {"mu": 0.4}))), "--json")

    choice = json.loads(out)
    assert (choice["runtime"], choice["low"], choice["high"]) == (0.05, 0.04, 0.1)
    assert (choice["configuration"], choice["source"]) == ("best", PREDICTED)


@pytest.mark.parametrize(
    "answer",
    [problem(404, "not_found", "nothing is known"), problem(503, "busy", "later"), Reply(200, {"front": 7}),
     problem(426, "outdated", "update"), Reply(200, raw=b"a hotel's log-in page")],
)  # fmt: skip
def test_without_a_recommendation_the_reference_is_scaled(answer: Reply, chosen: Choosing) -> None:
    out, requests = chosen(answer, "--json")

    choice = json.loads(out)
    assert len(requests) == 1
    assert (choice["configuration"], choice["source"]) == ("best", SCALED)
    assert (choice["low"], choice["high"]) == (None, None)


def test_the_server_is_not_asked_about_another_device_than_the_last(chosen: Choosing) -> None:
    answer = Reply(200, recommendation(recommended("best", {"mu": 0.4})))

    out, requests = chosen(answer, "--device", "older", "--json", others=("older",))

    assert requests == []
    assert json.loads(out)["source"] == SCALED


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        ((0.05,), "best"),  # the fastest within the error
        ((0.02,), "fine"),
        ((0.05, 0.060), "fine"),  # the most accurate that is fast enough
        ((0.05, 0.033), "best"),
    ],
)
def test_limits_of_error_and_time_decide(limits: tuple[float, ...], name: str) -> None:
    candidates = points(FRONT, [session(run("default", 100, 0.010), run("best", 10, 0.040))])

    assert choose(candidates, *limits).name == name
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
def test_the_choice_runs_over_the_shipped_sequence(home: Home, spool: Spool, terminal: Terminal) -> None:
    server = "http://127.0.0.1:1"
    configurations = [
        manifests.configuration(name, parameters) for name, parameters in room.CONFIGURATIONS.items()
    ]
    front = manifests.manifest(configurations=configurations)
    home.write("manifest-1.json", {"server": server, "manifest": front})
    here = description.opencl_identity(choose_device().handle)
    spool.put(server, session(DEFAULT, run("best", 40, 0.03)) | {"device": here})

    code, output, _ = terminal("choose", "--max-ate", "0.05", "--run", str(LIVING_ROOM), "--frames", "12")

    assert code == 0
    assert "best of front kfusion 1" in output
    assert "volume_resolution = 64" in output
    assert re.search(r"living-room, 12 frames: [\d.]+ ms a frame, [\d.]+ frames a second", output)
    assert re.search(r"largest trajectory error [\d.]+ cm, within the limit of 5 cm", output)
