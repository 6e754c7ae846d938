"""What happens to a submission that is as it should be."""

import json
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from django.db import connection

from crowd.devices.models import Installation
from crowd.devices.recognition import RecognisedDevice
from crowd.fronts.models import FrontVersion
from crowd.http.problems import Problem
from crowd.results.figures import sessions as session_figures
from crowd.results.intake import storing
from crowd.results.intake.daily_limits import Sender
from crowd.results.models import DeviceSpeedup, MeasurementSession, Run, SessionSummary, Submission
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.participant import Participant


def test_a_submission_is_stored_run_by_run_and_answered_item_by_item(participant: Participant) -> None:
    document = submission_document()

    response = participant.submit(document)

    assert response.status_code == 202
    runs = document["sessions"][0]["runs"]
    assert response.json()["items"] == [{"id": run["id"], "status": "accepted", "code": None} for run in runs]
    assert Submission.objects.get().pk.__str__() == response.json()["submission_id"]
    session = MeasurementSession.objects.get()
    assert (session.device.slug, session.processor) == ("google-pixel-8", "Mali-G715")
    assert session.description.raw == document["device"]
    stored = Run.objects.select_related("configuration").order_by("order")
    assert [run.configuration.name for run in stored] == ["default", "best", "best", "default"]
    assert {run.state for run in stored} == {"valid"}
    assert [run.mean_us for run in stored] == [80_000, 10_000, 10_000, 80_000]


def test_a_submission_becomes_a_speedup(participant: Participant) -> None:
    participant.submit(submission_document())

    summary = SessionSummary.objects.get()
    assert (summary.pairs, summary.state, summary.reason) == (2, "valid", "")
    speedup = DeviceSpeedup.objects.get()
    assert speedup.speedup == pytest.approx(8.0)
    assert (speedup.low, speedup.high, speedup.sessions, speedup.installations) == (None, None, 1, 1)


def test_a_replayed_submission_changes_nothing(participant: Participant) -> None:
    document = submission_document()
    first = participant.submit(document, key="a")
    before = list(Run.objects.values_list("pk", "uuid")), DeviceSpeedup.objects.get().sessions

    again = participant.submit(document, key="a")

    assert (again.status_code, again.content) == (200, first.content)
    assert (list(Run.objects.values_list("pk", "uuid")), DeviceSpeedup.objects.get().sessions) == before
    assert Submission.objects.count() == 1


def test_a_gzipped_submission_is_the_same_submission(participant: Participant) -> None:
    body = json.dumps(submission_document()).encode()
    first = participant.submit(body, key="a")

    again = participant.submit_gzipped(body, **{"Idempotency-Key": "a"})

    assert first.status_code == 202
    assert (again.status_code, again.content) == (200, first.content)


def test_runs_sent_again_under_another_key_are_duplicates(participant: Participant) -> None:
    document = submission_document()
    participant.submit(document)

    again = participant.submit(document)

    assert again.status_code == 202
    assert {item["status"] for item in again.json()["items"]} == {"duplicate"}
    assert (Run.objects.count(), MeasurementSession.objects.count()) == (4, 1)
    assert DeviceSpeedup.objects.get().sessions == 1


def test_a_session_may_come_in_two_parts(participant: Participant) -> None:
    session = session_document()
    first, second = session["runs"][:2], session["runs"][2:]
    participant.submit(submission_document(session | {"runs": first}))

    participant.submit(submission_document(session | {"runs": second}))

    assert MeasurementSession.objects.get().runs.count() == 4
    assert SessionSummary.objects.get().pairs == 2


def test_a_session_summarised_while_its_second_part_comes_is_summarised_again(
    participant: Participant, no_worker: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = session_document()
    first, second = session["runs"][:2], session["runs"][2:]
    participant.submit(submission_document(session | {"runs": first}))
    real = storing.recognise

    def summarised_meanwhile(*device: Any) -> RecognisedDevice:
        """The second part is checked by now and not stored yet."""
        session_figures.summarise_waiting()
        return real(*device)

    monkeypatch.setattr(storing, "recognise", summarised_meanwhile)
    participant.submit(submission_document(session | {"runs": second}))
    assert SessionSummary.objects.get().pairs == 1

    session_figures.summarise_waiting()

    assert SessionSummary.objects.get().pairs == 2


def test_a_bad_run_never_costs_the_good_ones(participant: Participant) -> None:
    session = session_document()
    session["runs"][1]["frame_us"][3] = "fast"
    session["runs"][2]["frame_us"] = [10_000] * 99

    response = participant.submit(submission_document(session))

    assert response.status_code == 202
    items = response.json()["items"]
    assert [item["status"] for item in items] == ["accepted", "rejected", "rejected", "accepted"]
    assert (items[1]["code"], items[1]["field"]) == ("invalid_field", "sessions[0].runs[1].frame_us[3]")
    assert (items[2]["code"], items[2]["field"]) == ("frame_count", "sessions[0].runs[2].frame_us")
    assert items[1]["id"] == session["runs"][1]["id"]
    assert set(Run.objects.values_list("configuration__name", flat=True)) == {"default"}


def test_a_failed_run_is_kept_with_its_reason_and_does_not_count(participant: Participant) -> None:
    session = session_document()
    failed = {"status": "failed", "failure": "out of memory", "frame_us": [], "stages_us": {}, "tracked": []}
    errors = {"ate_max": None, "ate_mean": None, "ate_rmse": None}
    session["runs"][1] |= failed | errors
    session["runs"][2] |= failed | errors

    assert participant.submit(submission_document(session)).status_code == 202

    run = Run.objects.filter(status="failed").first()
    assert run is not None
    assert (run.failure, run.state, run.reason, run.mean_us) == ("out of memory", "invalid", "failed", None)
    assert SessionSummary.objects.get().reason == "failed"
    assert not DeviceSpeedup.objects.exists()


def test_a_configuration_that_loses_tracking_is_invalid_not_fast(participant: Participant) -> None:
    session = session_document(best_us=100)
    for run in session["runs"][1:3]:
        run["ate_max"] = 0.05

    participant.submit(submission_document(session))

    summary = SessionSummary.objects.get()
    assert (summary.state, summary.reason, summary.log_ratio) == ("invalid", "ate_above_limit", None)
    assert not DeviceSpeedup.objects.exists()


def test_a_drift_is_shown_and_not_punished(participant: Participant) -> None:
    session = session_document()
    session["runs"][3] = run_document("default", 1, 3, 100_000)

    participant.submit(submission_document(session))

    summary = SessionSummary.objects.get()
    assert (summary.state, summary.reason) == ("valid", "")
    assert summary.drift == pytest.approx(1.25)


def test_a_valid_session_outweighs_suspect_ones(participant: Participant) -> None:
    incomplete = session_document()
    del incomplete["runs"][3]
    participant.submit(submission_document(incomplete))

    participant.submit(submission_document())

    speedup = DeviceSpeedup.objects.get()
    assert (speedup.state, speedup.sessions) == ("valid", 1)
    assert speedup.speedup == pytest.approx(8.0)


def test_the_state_of_a_submission_names_the_device_and_its_speedup(participant: Participant) -> None:
    key = participant.submit(submission_document()).json()["submission_id"]

    state = participant.get(f"/submissions/{key}").json()

    assert (state["device"], state["summarised"]) == ("google-pixel-8", True)
    assert participant.client.get(state["page"]).status_code == 200
    assert state["sessions"][0]["speedups"][0]["speedup"] == pytest.approx(8.0)
    assert state["sessions"][0]["started_at"] == "2026-11-20T10:00:00Z"


def test_a_dry_run_answers_alike_and_stores_nothing(participant: Participant) -> None:
    document = submission_document()

    response = participant.submit(document, path="/submissions:validate")

    assert response.status_code == 200
    assert {item["status"] for item in response.json()["items"]} == {"accepted"}
    judged = [(one["configuration"], one["state"]) for one in response.json()["judged"]]
    assert judged == [("default", "valid"), ("best", "valid")]
    assert not Submission.objects.exists()
    assert not MeasurementSession.objects.exists()


@pytest.mark.django_db(transaction=True)
def test_what_comes_while_its_installation_is_erased_is_refused(
    front: FrontVersion, installation: Installation
) -> None:
    """The token was good when the request came, and nothing is left to store it under."""
    Installation.objects.filter(pk=installation.pk).delete()

    with pytest.raises(Problem) as refused:
        storing.accept_submission(Sender(installation), "a", json.dumps(submission_document()).encode())

    assert (refused.value.status, refused.value.code) == (401, "token_invalid")
    assert not Submission.objects.exists()
    assert not Run.objects.exists()


@pytest.mark.django_db(transaction=True)
def test_a_request_that_comes_many_times_at_once_is_stored_once(
    front: FrontVersion, installation: Installation
) -> None:
    body = json.dumps(submission_document()).encode()

    def send(key: str) -> storing.Acceptance:
        try:
            return storing.accept_submission(Sender(installation), key, body)
        finally:
            connection.close()

    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(send, ["a", "a", "b", "b"]))

    assert len({answer.answer for answer in answers}) == 2
    assert sorted(answer.replayed for answer in answers) == [False, False, True, True]
    assert Submission.objects.count() == 2
    assert (MeasurementSession.objects.count(), Run.objects.count()) == (1, 4)
