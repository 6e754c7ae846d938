"""Lists of sessions and runs, and one session with its frames: filters, pages, and what is private."""

import uuid
from collections.abc import Iterator
from typing import Any

import pytest
from django.test import Client

from crowd.devices.models import DeviceModel
from crowd.results import moderation
from crowd.results.models import MeasurementSession, Run
from crowd.results.reading import lists
from tests.builders import crowds
from tests.builders.crowds import Join
from tests.builders.documents import device_document, run_document, session_document, submission_document
from tests.builders.participant import API, Participant

GALAXY = {"manufacturer": "samsung", "opencl_device": "Adreno (TM) 750", "soc_model": "SM8650"}


def send(who: Participant, model: str = "Pixel 8", started_at: str = "", **changes: Any) -> dict[str, Any]:
    """One session of `who` on `model`; its document."""
    session = session_document(**({"started_at": started_at} if started_at else {}))
    crowds.send(who, session, device=device_document(model, **changes))
    return session


@pytest.fixture
def crowd(front: Any, join: Join) -> dict[str, str]:
    """The ids of four sessions by a word for each, oldest first."""
    return {
        "old": send(join(), "Pixel 8", "2026-11-01T08:59:59Z")["id"],
        "galaxy": send(join(), "Galaxy S24", "2026-11-10T12:00:00Z", **GALAXY)["id"],
        "twin": send(join(), "Pixel 9", "2026-11-20T10:17:00Z")["id"],
        "other twin": send(join(), "Pixel 9", "2026-11-20T10:17:00Z")["id"],
    }


def words(client: Client, crowd: dict[str, str], path: str, **query: str) -> list[str]:
    """Which of `crowd`'s sessions the list at `path` has, in its order."""
    response = client.get(f"{API}{path}", query)
    assert response.status_code == 200, response.content
    known = {key: word for word, key in crowd.items()}
    rows = response.json()["results"]
    return list(dict.fromkeys(known[row["session" if path == "/runs" else "id"]] for row in rows))


NEWEST_FIRST = ["other twin", "twin", "galaxy", "old"]


FILTERS: list[tuple[dict[str, str], list[str]]] = [
    ({}, NEWEST_FIRST),
    ({"application": "kfusion"}, NEWEST_FIRST),
    ({"front": "kfusion-test"}, NEWEST_FIRST),
    ({"device": "9 google"}, ["other twin", "twin"]),
    ({"device": "pixel fold"}, []),
    ({"vendor": "adreno"}, ["galaxy"]),
    ({"vendor": "Mali", "device": "8"}, ["old"]),
    ({"gpu": "adreno"}, ["galaxy"]),
    ({"soc": '"Google Tensor G3"'}, ["other twin", "twin", "old"]),
    ({"os": "windows"}, []),
    ({"backend": "opencl"}, NEWEST_FIRST),
    ({"backend": "webgpu"}, []),
    ({"since": "2026-11-10"}, ["other twin", "twin", "galaxy"]),
    ({"until": "2026-11-10"}, ["galaxy", "old"]),
    ({"since": "2026-11-02", "until": "2026-11-19"}, ["galaxy"]),
    ({"configuration": "best"}, NEWEST_FIRST),
    ({"configuration": "accurate"}, []),
    ({"valid": "1"}, NEWEST_FIRST),
    ({"valid": "0"}, []),
    ({"confirmed": "1"}, NEWEST_FIRST),
    ({"confirmed": "0"}, []),
    ({"simulated": "0"}, NEWEST_FIRST),
    ({"simulated": "1"}, []),
    ({"simulated": "1", "confirmed": "1", "vendor": "Mali"}, []),
    ({"device": ""}, NEWEST_FIRST),
]


@pytest.mark.slow
@pytest.mark.parametrize("many", [0, lists.MANY_SESSIONS])
def test_filters_however_many_sessions_they_leave(
    client: Client,
    crowd: dict[str, str],
    many: int,
    monkeypatch: pytest.MonkeyPatch,
    subtests: pytest.Subtests,
) -> None:
    monkeypatch.setattr(lists, "MANY_SESSIONS", many)

    for path in ("/sessions", "/runs"):
        for query, expected in FILTERS:
            with subtests.test(path, **query):
                assert words(client, crowd, path, **query) == expected


def test_a_figure_that_too_few_confirm_is_not_confirmed(
    client: Client, crowd: dict[str, str], settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 2

    # Pixel 8 and 9 share a chip: three networks agree on it.
    for path in ("/sessions", "/runs"):
        assert words(client, crowd, path, confirmed="0") == ["galaxy", "old"]
        assert words(client, crowd, path, confirmed="1") == ["other twin", "twin"]


@pytest.mark.parametrize("path", ["/sessions", "/runs"])
def test_what_is_hidden_has_its_state_and_is_found_by_it(
    client: Client, crowd: dict[str, str], path: str
) -> None:
    hidden = MeasurementSession.objects.get(uuid=crowd["galaxy"])
    moderation.decide("quarantine", "ada", "a bench of the maker", hidden)

    assert words(client, crowd, path, valid="0") == ["galaxy"]
    assert words(client, crowd, path, valid="1") == ["other twin", "twin", "old"]
    assert words(client, crowd, path) == NEWEST_FIRST


@pytest.mark.parametrize(
    "path", ["/sessions", "/runs", f"/sessions/{uuid.UUID(int=1)}", "/models", "/devices"]
)
def test_an_unknown_parameter_is_refused_by_its_name(client: Client, front: Any, path: str) -> None:
    refused = client.get(f"{API}{path}", {"devise": "pixel"})

    assert (refused.status_code, refused.json()["code"]) == (400, "invalid_filter")
    assert refused.json()["field"] == "devise"


REFUSED: list[tuple[dict[str, str], int, str]] = [
    ({"limit": "1001"}, 400, "limit"),
    ({"limit": "0"}, 400, "limit"),
    ({"cursor": "???"}, 400, "cursor"),
    ({"cursor": "YWJj"}, 400, "cursor"),
    ({"cursor": "MTIzZTQ1NjctZTg5Yi0xMmQzLWE0NTYtNDI2NjE0MTc0MDAw"}, 400, "cursor"),
    ({"since": "yesterday"}, 400, "since"),
    ({"since": "2026-11-02", "until": "2026-11-01"}, 400, "until"),
    ({"valid": "maybe"}, 400, "valid"),
    ({"confirmed": "2"}, 400, "confirmed"),
    ({"vendor": "none"}, 400, "vendor"),
    ({"front": "kfusion-none"}, 404, "front"),
    ({"application": "none"}, 404, "application"),
    ({"application": "elasticfusion", "front": "kfusion-test"}, 400, "front"),
]


@pytest.mark.parametrize("path", ["/sessions", "/runs"])
def test_a_query_that_cannot_be_understood(
    client: Client, front: Any, path: str, subtests: pytest.Subtests
) -> None:
    for query, status, field in REFUSED:
        with subtests.test(**query):
            refused = client.get(f"{API}{path}", query)

            assert (refused.status_code, refused.json()["field"]) == (status, field), refused.json()


def pages(client: Client, address: str | None) -> Iterator[list[dict[str, Any]]]:
    while address:
        page = client.get(address).json()
        yield page["results"]
        address = page["next"]


def test_pages_go_on_where_the_last_one_ended_whatever_comes_or_goes(
    client: Client, crowd: dict[str, str], join: Join
) -> None:
    walk = pages(client, f"{API}/sessions?limit=1&backend=opencl")
    seen = [next(walk)[0]["id"], next(walk)[0]["id"]]
    late = send(join(), "Pixel 9", "2026-11-15T00:00:00Z")["id"]
    send(join(), "Pixel 9", "2026-11-22T00:00:00Z")
    seen += [page[0]["id"] for page in walk]

    # One that started before where the walk was is still to come; a newer one is not.
    assert seen == [crowd["other twin"], crowd["twin"], late, crowd["galaxy"], crowd["old"]]


def test_pages_of_runs_cross_sessions_and_repeat_nothing(
    client: Client, crowd: dict[str, str], join: Join
) -> None:
    whole = client.get(f"{API}/runs").json()["results"]
    walk = pages(client, f"{API}/runs?limit=3")
    seen = next(walk)
    send(join(), "Pixel 9", "2026-11-22T00:00:00Z")
    seen += [row for page in walk for row in page]

    assert len(whole) == 16
    assert seen == whole


def test_a_cursor_whose_row_is_erased_says_so(client: Client, front: Any, join: Join) -> None:
    first, second = join(), join()
    send(first, started_at="2026-11-01T00:00:00Z")
    send(second, started_at="2026-11-02T00:00:00Z")
    following = client.get(f"{API}/sessions?limit=1").json()["next"]

    assert second.delete("/me").status_code == 204

    assert client.get(following).json()["code"] == "invalid_cursor"
    assert len(client.get(f"{API}/sessions").json()["results"]) == 1


def test_an_erased_run_is_in_no_answer(client: Client, front: Any, join: Join) -> None:
    who = join()
    session = send(who)
    gone = session["runs"][0]["id"]

    assert who.delete(f"/me/runs/{gone}").status_code == 204

    for path in ("/runs", f"/sessions/{session['id']}"):
        assert gone not in client.get(f"{API}{path}").content.decode()
    assert len(client.get(f"{API}/runs").json()["results"]) == 3


def test_a_session_has_its_runs_with_their_frames(client: Client, crowd: dict[str, str]) -> None:
    detail = client.get(f"{API}/sessions/{crowd['galaxy']}").json()
    listed = client.get(f"{API}/sessions?device=galaxy").json()["results"][0]
    runs = client.get(f"{API}/runs?session={crowd['galaxy']}").json()["results"]

    assert {name: detail[name] for name in listed} == listed
    assert detail["device"] == "samsung-galaxy-s24"
    assert (detail["application"], detail["processor"]) == ("kfusion", "Adreno 750")
    assert detail["speedups"][0]["speedup"] == pytest.approx(8.0)
    assert detail["samples"] == [{"t": 0.0, "temperature_c": 41.5, "cpu_mhz": 2400.0, "battery": None}]
    assert [run["order"] for run in detail["runs"]] == [0, 1, 2, 3]
    first = detail["runs"][0]
    assert (first["frame_us"], first["stages_us"]["tracking"]) == ([80_000] * 100, [16_000] * 100)
    assert first["tracked"] == [None] * 4 + [True] * 96
    by_id = {run["id"]: run for run in runs}
    for run in detail["runs"]:
        one = by_id[run["id"]]
        assert run["mean_us"] == pytest.approx(one["mean_us"])
        assert {name: one[name] for name in run.keys() & one.keys() - {"mean_us"}} == {
            name: run[name] for name in run.keys() & one.keys() - {"mean_us"}
        }
        assert (one["device"], one["state"]) == ("samsung-galaxy-s24", "valid")
    assert client.get(f"{API}/sessions/{uuid.uuid4()}").json()["code"] == "not_found"


def test_times_are_public_only_to_the_hour(client: Client, crowd: dict[str, str]) -> None:
    listed = client.get(f"{API}/sessions").json()["results"]

    assert [row["started_at"] for row in listed[:2]] == ["2026-11-20T10:00:00Z"] * 2
    assert listed[0]["received_at"].endswith(":00:00Z")
    assert {row["started_at"][14:] for row in client.get(f"{API}/runs").json()["results"]} == {"00:00Z"}


@pytest.mark.slow
def test_an_unchanged_answer_is_not_sent_again(client: Client, crowd: dict[str, str], join: Join) -> None:
    for path in ("/sessions?limit=2", "/runs?limit=2", f"/sessions/{crowd['old']}"):
        tag = client.get(f"{API}{path}").headers["ETag"]
        again = client.get(f"{API}{path}", headers={"If-None-Match": tag})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["ETag"] == tag

    send(join(), started_at="2026-11-23T00:00:00Z")

    assert client.get(f"{API}/sessions?limit=2", headers={"If-None-Match": tag}).status_code == 200


def test_a_rare_model_is_named_nowhere_and_found_by_its_chip_alone(
    client: Client, front: Any, join: Join, settings: Any
) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    who = join()
    session = send(who, board="husky-build-77", opencl_driver="3.0 v1.r44p1-00eac0.3a7f")
    run = session["runs"][0]["id"]

    for path in (
        "/sessions",
        "/runs",
        f"/sessions/{session['id']}",
        "/sessions?device=tensor",
        "/runs?device=tensor",
        f"/runs?session={session['id']}",
    ):
        content = client.get(f"{API}{path}").content.decode()
        assert "google-tensor-g3-device-" in content, path
        secrets = ("Pixel", "pixel", "husky-build-77", "3a7f", who.installation_id)
        assert [text for text in secrets if text in content] == [], path
        assert run in content or path.startswith("/sessions?") or path == "/sessions"
    for path in ("/sessions", "/runs"):
        for name in ("pixel", "Pixel 8", "husky", "google-pixel-8"):
            assert client.get(f"{API}{path}", {"device": name}).json()["results"] == [], name
    DeviceModel.objects.update(rare=False)
    assert "google-pixel-8" in client.get(f"{API}/sessions").content.decode()


def test_what_only_the_sender_may_read_is_in_no_answer(client: Client, front: Any, join: Join) -> None:
    run = run_document("default", 0, 0, 80_000, note="mine alone") | {"status": "failed", "frame_us": []}
    run |= {"failure": "secret path of mine", "stages_us": {}, "tracked": []}
    sample = {"t": 0.0, "temperature_c": None, "cpu_mhz": None, "battery": None, "fan": "mine alone"}
    session = session_document(samples=[sample], mood="mine alone") | {"runs": [run]}
    assert join().submit(submission_document(session)).status_code == 202

    for path in ("/sessions", "/runs", f"/sessions/{session['id']}"):
        content = client.get(f"{API}{path}").content.decode()
        assert "mine" not in content, path
    assert client.get(f"{API}/runs").json()["results"][0]["failure"] == "other failure"


def test_lists_cost_the_same_however_many_there_are(
    client: Client, crowd: dict[str, str], join: Join, django_assert_max_num_queries: Any
) -> None:
    everything = "device=pixel&vendor=Mali&confirmed=1&valid=1&front=kfusion-test&configuration=best"
    budgets = {"/sessions": 5, f"/sessions?{everything}": 11, "/runs": 3, f"/runs?{everything}": 9}
    for path in budgets:
        client.get(f"{API}{path}")  # what a process keeps is kept now
    send(join(), "Pixel 9", "2026-11-22T00:00:00Z")
    for path, budget in budgets.items():
        client.get(f"{API}{path}")
        with django_assert_max_num_queries(budget):
            assert len(client.get(f"{API}{path}").json()["results"]) >= 3
    following = client.get(f"{API}/sessions?limit=1").json()["next"]
    with django_assert_max_num_queries(6):
        client.get(following)


def test_a_session_without_runs_is_in_the_list_of_sessions_alone(
    client: Client, crowd: dict[str, str]
) -> None:
    Run.objects.filter(session__uuid=crowd["twin"]).delete()

    assert words(client, crowd, "/runs") == ["other twin", "galaxy", "old"]
    assert words(client, crowd, "/sessions") == NEWEST_FIRST
