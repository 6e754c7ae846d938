"""The addresses of predictions, as outside programs call them."""

import math
from typing import Any

import pytest
from django.test import Client

from crowd.fronts.models import Configuration, FrontVersion
from crowd.predictions import maps, measurements
from crowd.predictions.models import ProbeAssignment
from tests.builders.known_front import NAME
from tests.builders.measured import ADRENO, BEST_IS_BEST
from tests.builders.participant import API


def recommendation(client: Client, query: str = "", **headers: str) -> Any:
    return client.get(f"{API}/recommendation{query}", headers=headers)


@pytest.mark.slow
def test_before_the_first_map_the_reference_says_what_to_use(client: Client, measured: Any) -> None:
    measured()

    body = recommendation(client).json()

    assert (body["configuration"], body["state"], body["about"]) == ("best", "predicted", "any device")
    assert body["basis"] == {"rung": "reference", "sessions": 0, "devices": 0, "nearest": []}
    assert body["predicted"]["low"] < body["predicted"]["ratio"] < body["predicted"]["high"]
    assert (body["application"], body["front_version"]) == ("kfusion", NAME)
    assert body["default_seconds"] is None
    assert len(body["front"]) == 13
    assert body["parameters"]["volume_resolution"] == 128


@pytest.mark.slow
def test_without_a_confirmed_figure_nothing_is_recommended(
    client: Client, measured: Any, settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    first, _ = measured("Pixel 8"), measured("Pixel 4", ADRENO)
    maps.rebuild()

    for query in ("", "?gpu=Adreno+650"):
        response = recommendation(client, query)
        assert response.status_code == 404
        waiting = "" if query else ", 2 unconfirmed devices wait for more networks"
        assert f"no figure of kfusion-4 is confirmed yet{waiting}" in response.json()["detail"]
        assert "0 unconfirmed" not in response.json()["detail"]
    by_model = recommendation(client, "?model=google-pixel-8").json()["detail"]
    assert "'google-pixel-8' is confirmed yet, 1 unconfirmed device waits for more networks" in by_model
    body = recommendation(client, **first.participant.headers).json()
    states = {row["configuration"]: row["state"] for row in body["front"]}
    assert (states["best"], states["knee"]) == ("measured", "predicted")


@pytest.mark.slow
def test_a_token_sees_own_sessions_and_the_confirmed_ones_of_others(
    client: Client, measured: Any, settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    others = [measured("Pixel 8") for _ in range(3)]
    different = measured("Pixel 8", costs={"raycasting": 4.0})

    with_token = {
        row["configuration"]: row
        for row in recommendation(client, **different.participant.headers).json()["front"]
    }
    public = {
        row["configuration"]: row for row in recommendation(client, "?model=google-pixel-8").json()["front"]
    }

    assert with_token["best"]["ratio"] == pytest.approx(math.exp(different.log_ratio("best")), rel=0.01)
    assert public["best"]["ratio"] == pytest.approx(math.exp(others[0].log_ratio("best")), rel=0.03)


def test_a_probe_counts_where_a_quorum_was_asked_for_it(client: Client, measured: Any, settings: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    devices = [measured("Pixel 8", probes=["probe-02"]) for _ in range(3)]

    def of_the_model() -> Any:
        [group] = measurements.groups()
        return measurements.read(group, 10).figures

    assert {name for _, name in of_the_model()} == {"best"}
    probe = Configuration.objects.get(name="probe-02")
    for device in devices:
        ProbeAssignment.objects.create(
            installation_id=device.participant.installation_id, configuration=probe, seed=0
        )
    figures = {name: figure for (_, name), figure in of_the_model().items()}
    assert set(figures) == {"best", "probe-02"}
    assert figures["probe-02"].log_ratio == pytest.approx(devices[0].log_ratio("probe-02"), abs=0.01)


@pytest.mark.slow
def test_a_token_asks_for_its_own_device(client: Client, measured: Any) -> None:
    device = measured(costs=BEST_IS_BEST)
    maps.rebuild()

    response = recommendation(client, **device.participant.headers)

    assert response["Cache-Control"] == "private, no-store"
    body = response.json()
    assert (body["configuration"], body["state"], body["about"]) == ("best", "measured", "Google Pixel 8")
    assert body["default_seconds"] == pytest.approx(device.seconds("default"), rel=0.01)
    assert body["basis"]["rung"] == "stages"


@pytest.mark.slow
def test_devices_are_found_by_name_chip_and_soc(client: Client, measured: Any) -> None:
    measured("Pixel 8")
    measured("Pixel 4", ADRENO)
    maps.rebuild()

    for query, slug in (("?gpu=Adreno+740", "google-pixel-4"), ("?gpu=mali", "google-pixel-8")):
        assert recommendation(client, query).json()["basis"]["nearest"] == [slug]
    assert recommendation(client, "?model=pixel+8").json()["about"] == "Google Pixel 8"
    by_soc = recommendation(client, "?soc=tensor&model=pixel+4").json()["front"]
    assert [one["state"] for one in by_soc if one["configuration"] == "best"] == ["measured"]
    by_chip = recommendation(client, "?gpu=Adreno+740").json()
    assert (by_chip["state"], by_chip["about"]) == ("predicted", "a device like “Adreno 740”")
    unknown = recommendation(client, "?gpu=Adreno+650").json()
    assert unknown["about"] == "a device with Adreno 650 (no confirmed figure)"


def test_limits_are_kept(client: Client, measured: Any) -> None:
    measured()
    exact = recommendation(client, "?max_ate=0.018").json()

    assert (exact["configuration"], exact["ate_max"] <= 0.018) == ("front-04", True)
    assert exact["ate_max"] < exact["held_out_ate_max"]
    assert [len(names) for names in exact["sequences"].values()] == [6, 2]


REFUSED = [
    ("?model=Nokia", 404, "no measured device is called 'Nokia'"),
    ("?gpu=zzz", 404, "no known chip is called 'zzz'"),
    ("?max_ate=0.0001", 404, "the least is 0.0089 m, by accurate"),
    ("?max_ms=20", 404, "leave out max_ms"),
    ("?application=tetris", 404, "no front of 'tetris' is published here"),
    ("?backend=cuda", 400, "backend=cuda: give opencl, webgpu, wasm"),
    ("?max_ate=-1", 400, "max_ate=-1: give a number above 0"),
    ("?max_ms=nan", 400, "give a number above 0"),
    ("?gpu=" + "x" * 101, 400, "gpu: at most 100 characters"),
]


def test_what_cannot_be_answered_says_why(client: Client, measured: Any, subtests: pytest.Subtests) -> None:
    measured()

    for query, status, words in REFUSED:
        with subtests.test(query[:30]):
            response = recommendation(client, query)

            assert response.status_code == status
            assert words in response.json()["detail"]


def test_a_token_that_is_none_is_refused(client: Client, front: FrontVersion) -> None:
    assert recommendation(client, authorization="Bearer unknown").status_code == 401


@pytest.mark.slow
def test_the_manifest_of_a_session_of_probes(client: Client, measured: Any) -> None:
    device = measured()

    usual = client.get(f"{API}/manifest").json()
    answer = client.get(f"{API}/manifest?minutes=2", headers=device.participant.headers)

    assert answer.status_code == 200
    assert answer["Cache-Control"] == "private, no-store"
    body = answer.json()
    asked = [one["name"] for one in body["assigned"]]
    assert len(asked) == 3
    assert all(one["why"] for one in body["assigned"])
    assert [one["name"] for one in body["configurations"]] == ["default", *asked]
    assert body["protocol"] == usual["protocol"] | {"order": ["default", *asked], "repeats": 2}
    assert all(one["plan"] and one["trajectory"] and one["band"] for one in body["configurations"])
    for member in ("application", "front_version", "sequence", "consent_version"):
        assert body[member] == usual[member]
    assert "assigned" not in usual

    device.submit_probes(asked)
    again = client.get(f"{API}/manifest?minutes=2", headers=device.participant.headers).json()
    assert not set(asked) & {one["name"] for one in again["assigned"]}
    assert ProbeAssignment.objects.count() == 6


@pytest.mark.slow
def test_nothing_assigned_is_the_usual_manifest_with_a_reason(
    client: Client, front: FrontVersion, join: Any
) -> None:
    participant = join()

    body = client.get(f"{API}/manifest?minutes=2", headers=participant.headers).json()

    assert (body["assigned"], body["assigned_message"]) == ([], "Measure default and best first.")
    assert body["protocol"]["order"] == ["default", "best", "best", "default"]


def test_minutes_need_a_token_and_a_number(client: Client, front: FrontVersion, join: Any) -> None:
    known = join().headers

    for query, headers, status in (
        ("?minutes=2", {}, 401),
        ("?minutes=0", known, 400),
        ("?minutes=x", known, 400),
        ("", {}, 200),
    ):
        assert client.get(f"{API}/manifest{query}", headers=headers).status_code == status, query
