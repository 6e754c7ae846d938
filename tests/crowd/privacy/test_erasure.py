"""A participant sees everything that is kept of them, and can have it gone."""

from typing import Any
from uuid import UUID

import pytest
from django.test import Client

from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.results.models import (
    Decision,
    DeviceSpeedup,
    MeasurementSession,
    Run,
    SessionSummary,
    Submission,
    Tombstone,
)
from crowd.results.moderation import decide
from crowd.results.privacy import erasure
from tests.builders.crowds import Join
from tests.builders.documents import device_document, session_document, submission_document
from tests.builders.measuring import measure
from tests.builders.participant import API, Participant


def test_enrolment_gives_a_token_that_is_not_kept(client: Client, db: None) -> None:
    response = client.post(
        f"{API}/enrol",
        {"app": "client_kit", "app_version": "0.1.0", "consent_version": 2},
        content_type="application/json",
    )

    assert response.status_code == 201
    installation = Installation.objects.get(pk=response.json()["installation_id"])
    assert response.json()["token"] not in str(vars(installation))
    assert response.headers["Cache-Control"] == "no-store"


@pytest.mark.parametrize(
    ("changes", "status", "code"),
    [
        ({"app_version": "0.0.9"}, 426, "app_outdated"),
        ({"consent_version": 9}, 400, "consent_outdated"),
        ({"app": ""}, 400, "invalid_field"),
        ({"app": None}, 400, "invalid_field"),
    ],
)
def test_an_enrolment_that_is_refused(
    client: Client, db: None, changes: dict[str, object], status: int, code: str
) -> None:
    wish = {"app": "client_kit", "app_version": "0.1.0", "consent_version": 2} | changes

    response = client.post(f"{API}/enrol", wish, content_type="application/json")

    assert (response.status_code, response.json()["code"]) == (status, code)
    assert not Installation.objects.exists()


def test_own_data_is_what_was_sent(participant: Participant, join: Join) -> None:
    document = submission_document()
    participant.submit(document, key="mine")
    join().submit(submission_document())

    data = participant.own_data()

    assert data["installation"]["id"] == participant.installation_id
    assert [row["idempotency_key"] for row in data["submissions"]] == ["mine"]
    (session,) = data["sessions"]
    assert session["device"] == document["device"]
    sent = document["sessions"][0]
    assert session["samples"] == sent["samples"]
    kept = [{name: run[name] for name in sent["runs"][0]} for run in session["runs"]]
    assert kept == sent["runs"]


def test_erasing_everything_leaves_nothing(participant: Participant) -> None:
    participant.submit(submission_document())

    assert participant.delete("/me").status_code == 204

    for model in (
        Installation, Submission, MeasurementSession, Run, SessionSummary, DeviceSpeedup, DeviceDescription,
        DeviceModel,
    ):  # fmt: skip
        assert not model.objects.exists(), model
    assert participant.get("/me/data").json()["code"] == "token_invalid"


def test_erasing_takes_only_ones_own_and_the_figures_follow(participant: Participant, join: Join) -> None:
    measure(participant, best_us=5_000)
    measure(join(), best_us=20_000)
    assert DeviceSpeedup.objects.get().speedup == pytest.approx(8.0)

    participant.delete("/me")

    speedup = DeviceSpeedup.objects.get()
    assert (speedup.installations, speedup.speedup) == (1, pytest.approx(4.0))
    assert DeviceModel.objects.count() == 1


def test_erasing_one_run_leaves_the_others_and_the_figures_follow(participant: Participant) -> None:
    session = session_document()
    session["runs"][1]["frame_us"] = [5_000] * 100
    session["runs"][1]["stages_us"] = {}
    participant.submit(submission_document(session))

    assert participant.delete(f"/me/runs/{session['runs'][1]['id']}").status_code == 204

    assert Run.objects.count() == 3
    assert SessionSummary.objects.get().pairs == 1
    assert DeviceSpeedup.objects.get().speedup == pytest.approx(8.0)


def test_erasing_the_last_run_erases_the_session_and_the_device(participant: Participant) -> None:
    session = measure(participant)

    for run in session["runs"]:
        assert participant.delete(f"/me/runs/{run['id']}").status_code == 204

    for model in (MeasurementSession, Run, SessionSummary, DeviceSpeedup, DeviceModel, DeviceDescription):
        assert not model.objects.exists(), model


def test_nobody_erases_or_sees_what_another_sent(participant: Participant, join: Join) -> None:
    document = submission_document(submission_document()["sessions"][0], device=device_document())
    key = participant.submit(document).json()["submission_id"]
    other = join()

    assert other.delete(f"/me/runs/{document['sessions'][0]['runs'][0]['id']}").status_code == 404
    assert other.get(f"/submissions/{key}").status_code == 404
    assert other.own_data()["sessions"] == []
    assert Run.objects.count() == 4


def test_own_data_holds_every_stored_field(participant: Participant) -> None:
    """Also those that are added later: only what is said under another name is left out of its own."""
    participant.submit(submission_document())

    data = participant.own_data()

    (session,) = data["sessions"]
    elsewhere = {
        Installation: {"token_sha256", "next_token_sha256", "description_id"},
        Submission: {"installation_id"},
        MeasurementSession: {"uuid", "installation_id", "description_id", "device_id", "front_id"},
        # Only runs of the first protocol have a digest of their trajectory, and their own data says it.
        Run: {"uuid", "session_id", "configuration_id", "stages", "trajectory_sha256"},
        SessionSummary: {"id", "session_id", "installation_id", "configuration_id", "baseline_id"},
    }
    documents = {
        Installation: data["installation"],
        Submission: data["submissions"][0],
        MeasurementSession: session,
        Run: session["runs"][0],
        SessionSummary: session["summaries"][0],
    }
    for model, document in documents.items():
        fields = {field.attname for field in model._meta.concrete_fields}
        assert fields - elsewhere[model] <= document.keys(), model


def test_own_data_is_sent_in_pieces(participant: Participant) -> None:
    for _ in range(3):
        participant.submit(submission_document())

    pieces = list(participant.get("/me/data").streaming_content)

    assert max(map(len, pieces)) < sum(map(len, pieces)) / 2
    assert len(participant.own_data()["sessions"]) == 3


def test_decisions_of_administrators_are_exported_and_erased_with_the_rest(participant: Participant) -> None:
    document = submission_document()
    participant.submit(document)
    run = Run.objects.get(uuid=document["sessions"][0]["runs"][1]["id"])
    decide("quarantine", "an-administrator", "a copy of another's", run.session, run)

    (session,) = participant.own_data()["sessions"]

    (decision,) = session["decisions"]
    assert (decision["run"], decision["reason"]) == (str(run.uuid), "a copy of another's")
    assert "an-administrator" not in str(session)
    assert participant.delete(f"/me/runs/{run.uuid}").status_code == 204
    assert participant.delete("/me").status_code == 204
    assert not Decision.objects.exists()


@pytest.mark.slow
@pytest.mark.parametrize("erased", [[0, 1, 2, 3], [0, 3]], ids=["the whole session", "its baseline"])
def test_a_later_session_of_the_day_counts_in_an_erased_ones_place(
    participant: Participant, settings: Any, erased: list[int]
) -> None:
    """Five of a day count; without the first one's answer that is true of the five others."""
    settings.FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 0
    sessions = [session_document(started_at=f"2026-11-20T1{hour}:00:00Z") for hour in range(6)]
    for session in sessions:
        participant.submit(submission_document(session))
    assert list(SessionSummary.objects.order_by("started_at").values_list("counted", flat=True)) == [
        *[True] * 5,
        False,
    ]

    for place in erased:
        assert participant.delete(f"/me/runs/{sessions[0]['runs'][place]['id']}").status_code == 204

    assert list(SessionSummary.objects.values_list("counted", flat=True)) == [True] * 5
    assert DeviceSpeedup.objects.get().sessions == 5


def test_erasing_a_run_twice_buries_it_once(participant: Participant, installation: Installation) -> None:
    session = measure(participant)
    run = UUID(session["runs"][0]["id"])

    assert erasure.erase_run(installation, run)
    assert not erasure.erase_run(installation, run)

    assert Tombstone.objects.count() == 1
