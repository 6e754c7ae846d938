"""The choice of participants to show the names of their models, which few people have."""

from typing import Any

import pytest
from django.test import Client

from crowd.devices.models import Installation
from crowd.results import tasks
from crowd.results.models import MeasurementSession, SessionSummary, StoredFile
from crowd.results.opendata import exports
from crowd.results.validity.version import ALGORITHM
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.participant import API, Participant
from tests.builders.rare import NAMED, Join, masked, measure, work

pytestmark = pytest.mark.usefixtures("rare_below_five")


def test_a_rare_model_is_named_once_all_agree(client: Client, front: Any, join: Join) -> None:
    measure(join(), best_us=20_000, show_model=True)
    measure(join(), best_us=5_000, show_model=True)

    (row,) = client.get(f"{API}/speedups").json()["results"]

    assert (row["device"], row["installations"]) == (NAMED, 2)


def test_one_who_does_not_agree_masks_the_model_at_once(
    client: Client, front: Any, join: Join, no_worker: None
) -> None:
    """Before any task has run."""
    measure(join(), show_model=True)
    tasks.sweep()
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    measure(join())

    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert client.get(f"{API}/devices/{masked()}").status_code == 200


def test_raw_strings_are_never_shown(client: Client, front: Any, join: Join) -> None:
    measure(join(), show_model=True)

    page = client.get(f"/devices/{NAMED}/").content.decode()

    assert "Pixel 8" in page
    assert "husky-build-77" not in page


@pytest.mark.slow
def test_the_choice_may_be_taken_back(
    client: Client, front: Any, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    who = join()
    measure(who, show_model=True)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200

    with django_capture_on_commit_callbacks(execute=True):
        measure(who, show_model=False)

    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    (row,) = client.get(f"{API}/speedups").json()["results"]
    assert (row["device"], row["sessions"]) == (masked(), 2)


def test_the_choice_holds_for_sessions_that_compare_nothing_too(
    client: Client, front: Any, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    """No configuration beside the baseline: no summary, no figure, but a device in the list."""
    who = join()
    alone = session_document(runs=[run_document("default", 0, 0, 80_000)])
    who.submit(submission_document(alone, show_model=True))
    assert [row["slug"] for row in client.get(f"{API}/devices").json()["results"]] == [NAMED]

    with django_capture_on_commit_callbacks(execute=True):
        measure(who, show_model=False)

    rows = client.get(f"{API}/devices").json()["results"]
    assert [(row["slug"], row["sessions"]) for row in rows] == [(masked(), 2)]


def test_a_choice_moves_no_session(client: Client, front: Any, join: Join) -> None:
    """It costs the server little, however often somebody changes their mind."""
    who = join()
    measure(who)
    before = list(SessionSummary.objects.values_list("pk", "cohort"))

    for choice in (False, True):
        who.submit(submission_document(session_document(), show_model=choice))

    assert list(SessionSummary.objects.values_list("pk", "cohort"))[: len(before)] == before
    assert not MeasurementSession.objects.filter(summary_algorithm__lt=ALGORITHM).exists()
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200


def choose(who: Participant, content: Any) -> Any:
    return who.client.patch(f"{API}/me", content, content_type="application/json", headers=who.headers)


def test_the_choice_changes_without_a_measurement(client: Client, front: Any, join: Join) -> None:
    who = join()
    measure(who)
    hidden = masked()

    shown = choose(who, {"show_model": True})
    assert (shown.status_code, shown.json()["show_model"]) == (200, True)
    assert client.get(f"{API}/devices/{NAMED}").status_code == 200
    assert choose(who, {"show_model": False}).json()["show_model"] is False
    assert client.get(f"{API}/devices/{NAMED}").status_code == 404
    assert client.get(f"{API}/devices/{hidden}").status_code == 200


def test_a_name_is_shown_again_after_an_hour_and_hidden_at_any_time(front: Any, join: Join) -> None:
    who = join()
    measure(who)
    for show in (True, False):
        assert choose(who, {"show_model": show}).status_code == 200

    again = choose(who, {"show_model": True})

    assert (again.status_code, again.json()["code"]) == (429, "too_many_requests")
    assert 3_000 < int(again.headers["Retry-After"]) <= 3_600
    assert who.get("/me").json()["show_model"] is False
    assert choose(who, {"show_model": False}).status_code == 200


def test_open_data_follow_a_choice_without_a_measurement(
    front: Any, join: Join, django_capture_on_commit_callbacks: Any
) -> None:
    who = join()
    measure(who, show_model=True)
    exports.create_export()
    assert not StoredFile.objects.filter(stale=True).exists()

    with django_capture_on_commit_callbacks():
        choose(who, {"show_model": False})

    assert {file.table for file in StoredFile.objects.filter(stale=True)} >= {"devices", "sessions"}


def test_a_choice_is_yes_or_no(front: Any, join: Join) -> None:
    who = join()

    for content in ({}, {"show_model": None}, {"show_model": "yes"}, [True]):
        answer = choose(who, content)
        assert (answer.status_code, answer.json()["code"]) == (400, "invalid_field"), content


def test_a_submission_that_says_nothing_changes_no_choice(front: Any, join: Join) -> None:
    who = join()
    measure(who, show_model=True)

    measure(who)
    work()

    assert Installation.objects.get().show_model
