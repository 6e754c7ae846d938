"""What anybody may read: speedups, devices, comparisons."""

from typing import Any

import pytest
from django.test import Client

from tests.builders import crowds
from tests.builders.crowds import Join
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.participant import API, Participant


@pytest.fixture
def crowd(front: Any, join: Join) -> None:
    """Three phones, 4, 8 and 16 times faster with best, the last measured by three participants."""
    crowds.crowd(join, {"Pixel 8": 4.0})
    galaxy = {"manufacturer": "samsung", "opencl_device": "Adreno (TM) 750", "soc_model": "SM8650"}
    crowds.crowd(join, {"Galaxy S24": 8.0}, **galaxy)
    crowds.crowd(join, {"Pixel X": (16.0, 16.0, 16.0)})


def speedups(client: Client, **query: str) -> dict[str, Any]:
    response = client.get(f"{API}/speedups", query)
    assert response.status_code == 200, response.content
    return response.json()


def test_speedups_are_listed_fastest_first_with_the_crowds_figure(client: Client, crowd: None) -> None:
    answer = speedups(client)

    assert [row["device"] for row in answer["results"]] == [
        "google-pixel-x",
        "samsung-galaxy-s24",
        "google-pixel-8",
    ]
    assert [round(row["speedup"], 6) for row in answer["results"]] == [16, 8, 4]
    assert {(row["configuration"], row["baseline"]) for row in answer["results"]} == {("best", "default")}
    assert answer["front"] == "kfusion-test"
    assert answer["next"] is None
    assert answer["summary"]["devices"] == 3
    assert answer["summary"]["geometric_mean"] == pytest.approx(8.0)
    assert (answer["summary"]["min"], answer["summary"]["max"]) == (pytest.approx(4.0), pytest.approx(16.0))


def test_an_interval_is_given_from_three_installations_on(client: Client, crowd: None) -> None:
    rows = {row["device"]: row for row in speedups(client)["results"]}

    # The installations agree to the last digit, which is chance.
    assert 15.0 < rows["google-pixel-x"]["low"] < 16.0 < rows["google-pixel-x"]["high"]
    assert rows["google-pixel-x"]["installations"] == 3
    assert rows["google-pixel-8"]["low"] is None


PIXELS, GALAXY = ["google-pixel-x", "google-pixel-8"], ["samsung-galaxy-s24"]
EVERY = ["google-pixel-x", "samsung-galaxy-s24", "google-pixel-8"]
FILTERS: list[tuple[dict[str, str], list[str]]] = [
    ({"gpu": "adreno"}, GALAXY),
    ({"soc": "tensor"}, PIXELS),
    ({"os": "android"}, EVERY),
    ({"os": "Windows"}, []),
    ({"device": "8 google pixel"}, ["google-pixel-8"]),
    ({"device": "pixel fold"}, []),
    ({"gpu": '"mali-g715"'}, []),
    ({"gpu": '"Mali-G715"'}, PIXELS),
    ({"min_sessions": "3"}, ["google-pixel-x"]),
    ({"front": "kfusion-test", "backend": "opencl"}, EVERY),
    ({"since": "2026-11-20"}, EVERY),
    ({"since": "2026-11-21"}, []),
    ({"since": "2026-11-20", "gpu": "adreno"}, GALAXY),
    ({"configuration": "accurate"}, []),
]


def test_filters(client: Client, crowd: None, subtests: pytest.Subtests) -> None:
    for query, devices in FILTERS:
        with subtests.test(**query):
            answer = speedups(client, **query)

            assert [row["device"] for row in answer["results"]] == devices
            assert answer["summary"]["devices"] == len(devices)


def test_a_period_gives_the_same_figures_as_all_sessions_where_it_holds_them_all(
    client: Client, crowd: None
) -> None:
    assert speedups(client, since="2026-11-20") == speedups(client)


REFUSED: list[tuple[dict[str, str], int, str, str]] = [
    ({"since": "yesterday"}, 400, "since", ""),
    ({"min_sessions": "-1"}, 400, "min_sessions", ""),
    ({"limit": "0"}, 400, "limit", ""),
    ({"device": " ".join(map(str, range(1100)))}, 400, "device", ""),
    ({"gpu": "a" * 4000}, 400, "gpu", ""),
    ({"cursor": "???"}, 400, "cursor", ""),
    ({"cursor": "YWJj"}, 400, "cursor", ""),
    ({"front": "kfusion-none"}, 404, "front", "give one of kfusion-test"),
    ({"application": "none"}, 404, "application", "give one of kfusion"),
]


def test_a_filter_that_is_none_and_an_unknown_front_are_refused(
    client: Client, crowd: None, subtests: pytest.Subtests
) -> None:
    for query, status, field, detail in REFUSED:
        with subtests.test(f"{field} {status}"):
            response = client.get(f"{API}/speedups", query)

            assert (response.status_code, response.json()["field"]) == (status, field)
            assert detail in response.json()["detail"]


def test_lists_go_on_by_cursor(client: Client, crowd: None) -> None:
    seen, address = [], f"{API}/speedups?limit=1&os=Android"
    while address:
        page = client.get(address).json()
        assert page["summary"]["devices"] == 3
        seen += [row["device"] for row in page["results"]]
        address = page["next"]

    assert seen == ["google-pixel-x", "samsung-galaxy-s24", "google-pixel-8"]


def test_one_models_processors_are_kept_apart_and_count_once(client: Client, crowd: None, join: Join) -> None:
    device = device_document(
        "Pixel 8", opencl_device="cortex-a720", opencl_platform="Portable Computing Language"
    )
    join().submit(submission_document(session_document(best_us=5_000), device=device))

    answer = speedups(client)

    rows = [
        (row["processor"], round(row["speedup"]))
        for row in answer["results"]
        if row["device"] == "google-pixel-8"
    ]
    assert rows == [("Arm Cortex-A720", 16), ("Mali-G715", 4)]
    assert answer["summary"]["devices"] == 3
    # The GPU's figure counts for the model; the two are never averaged.
    assert answer["summary"]["min"] == pytest.approx(4.0)


def test_devices_are_listed_and_shown(client: Client, crowd: None) -> None:
    listed = client.get(f"{API}/devices").json()["results"]
    shown = client.get(f"{API}/devices/google-pixel-x").json()

    assert [(row["slug"], row["sessions"]) for row in listed] == [
        ("google-pixel-x", 3), ("samsung-galaxy-s24", 1), ("google-pixel-8", 1),
    ]  # fmt: skip
    assert (shown["session_count"], shown["installations"], len(shown["sessions"])) == (3, 3, 3)
    assert shown["speedups"][0]["configuration"] == "best"
    assert client.get(f"{API}/devices/none").json()["code"] == "not_found"


def test_the_list_of_devices_refuses_filters_that_it_does_not_take(client: Client, crowd: None) -> None:
    everything = client.get(f"{API}/devices").json()

    for name, value in {"device": "zzz", "front": "kfusion-test", "min_sessions": "3"}.items():
        refused = client.get(f"{API}/devices", {name: value})
        assert (refused.status_code, refused.json()["field"]) == (400, name)
        assert "takes application, simulated" in refused.json()["detail"]
    assert client.get(f"{API}/devices?application=kfusion&simulated=0&device=").json() == everything


def test_devices_are_compared(client: Client, crowd: None) -> None:
    answer = client.get(f"{API}/compare", {"devices": "google-pixel-8,samsung-galaxy-s24"}).json()

    assert [row["slug"] for row in answer["results"]] == ["google-pixel-8", "samsung-galaxy-s24"]
    assert client.get(f"{API}/compare", {"devices": "google-pixel-8"}).json()["field"] == "devices"
    assert client.get(f"{API}/compare", {"devices": "google-pixel-8,none"}).status_code == 404


def test_nothing_public_tells_who_measured(client: Client, participant: Participant) -> None:
    document = submission_document()
    participant.submit(document)

    for path in ("/speedups", "/devices", "/devices/google-pixel-8"):
        text = client.get(f"{API}{path}").content.decode()
        assert participant.installation_id not in text
        assert "10:17" not in text
