"""What each address of the API may cost in queries, whatever the number of rows."""

from typing import Any

import pytest
from django.test import Client

from tests.builders import crowds
from tests.builders.crowds import Join
from tests.builders.documents import run_document, session_document, submission_document
from tests.builders.participant import API, Participant

READS = {
    "/manifest": 2,
    "/fronts": 2,
    "/fronts/kfusion-test": 2,
    "/speedups": 3,
    "/speedups?since=2026-01-01": 5,
    "/speedups?gpu=mali&min_sessions=2&limit=1": 3,
    "/devices": 6,
    "/devices/google-pixel-8": 8,
    "/sessions": 3,
    "/runs": 3,
    "/compare?devices=google-pixel-8,google-pixel-9": 19,
    "/explorations": 1,
    "/exports": 2,
    "/models?maker=samsung&search=galaxy": 1,
    "/openapi.json": 0,
    "/docs": 0,
}
OWN = {"/me": 1, "/submissions/{submission}": 4, "/me/data": 10}
# A transaction's begin and end count too; 50 runs take two statements.
SUBMISSION, VALIDATION, ENROLMENT, ATTEMPT = 10, 5, 2, 2


@pytest.fixture
def crowd(front: Any, join: Join) -> Participant:
    """Two models with two sessions each."""
    return crowds.crowd(join, {"Pixel 8": (8.0, 8.0), "Pixel 9": (8.0, 8.0)})[-1]


@pytest.mark.slow
def test_a_read_costs_at_most(
    crowd: Participant, client: Client, django_assert_max_num_queries: Any, subtests: pytest.Subtests
) -> None:
    for path, budget in READS.items():
        with subtests.test(path):
            assert client.get(f"{API}{path}").status_code == 200  # what a process keeps is kept now
            with django_assert_max_num_queries(budget):
                client.get(f"{API}{path}")


def test_an_unchanged_manifest_costs_at_most(
    crowd: Participant, client: Client, django_assert_max_num_queries: Any
) -> None:
    etag = client.get(f"{API}/manifest").headers["ETag"]

    with django_assert_max_num_queries(2):
        assert client.get(f"{API}/manifest", headers={"If-None-Match": etag}).status_code == 304


@pytest.mark.slow
def test_what_an_installation_asks_costs_at_most(
    participant: Participant, django_assert_max_num_queries: Any, subtests: pytest.Subtests
) -> None:
    submission = participant.submit(submission_document()).json()["submission_id"]

    for path, budget in OWN.items():
        with subtests.test(path), django_assert_max_num_queries(budget):
            response = participant.get(path.format(submission=submission))
            assert response.status_code == 200
            assert b"".join(response)


@pytest.mark.parametrize("runs", [4, 50])
def test_a_submission_costs_the_same_however_many_runs_it_has(
    participant: Participant, no_worker: None, django_assert_max_num_queries: Any, runs: int
) -> None:
    participant.submit(submission_document())  # the device is known from now on
    measured = [run_document("best", n, n, 1000) for n in range(runs)]
    document = submission_document(session_document() | {"runs": measured})

    with django_assert_max_num_queries(VALIDATION):
        assert participant.submit(document, path="/submissions:validate").status_code == 200
    with django_assert_max_num_queries(SUBMISSION):
        assert participant.submit(document, key="a").status_code == 202
    with django_assert_max_num_queries(4):
        assert participant.submit(document, key="a").status_code == 200


def test_an_enrolment_costs_at_most(client: Client, db: None, django_assert_max_num_queries: Any) -> None:
    wish = {"app": "test", "app_version": "0.1.0", "consent_version": 2}

    with django_assert_max_num_queries(ENROLMENT):
        assert client.post(f"{API}/enrol", wish, content_type="application/json").status_code == 201


def test_an_attempt_costs_at_most(client: Client, db: None, django_assert_max_num_queries: Any) -> None:
    attempt = {"step": "opened", "gpu_vendor": "arm", "browser": "Chrome"}
    client.post(f"{API}/attempts", attempt, content_type="application/json")  # the first of its day

    with django_assert_max_num_queries(ATTEMPT):
        assert client.post(f"{API}/attempts", attempt, content_type="application/json").status_code == 204
