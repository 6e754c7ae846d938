"""An administrator closes the intake, or asks for newer programs, while the server runs."""

from typing import Any

import pytest
from django.contrib.auth import get_user_model
from django.core.exceptions import ValidationError
from django.db import IntegrityError, transaction
from django.test import Client
from django.urls import reverse

from crowd.fronts import intake_policy
from crowd.fronts.models import IntakePolicy
from crowd.results.models import Submission
from tests.builders.crowds import send
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant


@pytest.fixture
def administrator(db: None) -> Client:
    client = Client()
    client.force_login(get_user_model().objects.create_superuser("keeper"))
    return client


def decide(administrator: Client, **fields: str) -> None:
    """Fill in the form of the admin's one row, made on first use."""
    page = administrator.get(reverse("admin:fronts_intakepolicy_changelist"), follow=True)
    response = administrator.post(page.redirect_chain[-1][0], {"accepting": "on", **fields})
    assert response.status_code == 302, response.content


def enrol(client: Client, **changes: str) -> Any:
    wish = {"app": "test", "app_version": "1.0", "consent_version": 2} | changes
    return client.post(f"{API}/enrol", wish, content_type="application/json")


def test_without_a_decision_everything_is_accepted(db: None) -> None:
    assert intake_policy.current() == intake_policy.Policy(True, "", "0.1.0", 2)


def test_a_closed_intake_says_why_and_opens_again(administrator: Client, participant: Participant) -> None:
    decide(administrator, accepting="", message="moving house until Monday")
    manifest = participant.get("/manifest").json()
    refused = participant.submit(submission_document(), key="a")

    decide(administrator)
    taken = participant.submit(submission_document(), key="a")

    assert (manifest["accepting"], manifest["message"]) == (False, "moving house until Monday")
    assert (refused.status_code, refused.json()["code"]) == (503, "not_accepting")
    assert "moving house until Monday" in refused.json()["detail"]
    assert int(refused.headers["Retry-After"]) > 0
    assert taken.status_code == 202
    assert Submission.objects.count() == 1


def test_a_repeated_request_is_answered_even_while_closed(
    administrator: Client, participant: Participant
) -> None:
    document = submission_document()
    first = participant.submit(document, key="a")
    decide(administrator, accepting="")

    again = participant.submit(document, key="a")

    assert (again.status_code, again.content) == (200, first.content)


def test_older_programs_are_refused_with_the_minimum_version(
    administrator: Client, participant: Participant, client: Client
) -> None:
    decide(administrator, minimum_app_version="0.2")

    enrolment = enrol(client, app_version="0.1.9")
    refused = participant.submit(submission_document(app_version="0.1.9"))
    taken = participant.submit(submission_document(app_version="0.2.0+7"))

    assert participant.get("/manifest").json()["minimum_app_version"] == "0.2"
    for response in (enrolment, refused):
        assert (response.status_code, response.json()["code"]) == (426, "app_outdated")
        assert response.json()["minimum_app_version"] == "0.2"
    assert taken.status_code == 202


def test_versions_are_compared_as_numbers() -> None:
    policy = intake_policy.Policy(True, "", "1.10.0", 1)
    versions = ("0.99", "1.9.9", "1.10", "1.10.0", "1.10.0-beta", "2")

    assert [version for version in versions if policy.is_outdated(version)] == ["0.99", "1.9.9"]


def test_a_version_is_numbers_and_a_short_suffix(participant: Participant) -> None:
    for version in ("1", "0.1.0", "1.10.0-beta.2", "2.0+7", "1.2.3-rc1+2026"):
        send(participant, app_version=version)


@pytest.mark.parametrize(
    "version", ["", "new", "1.0-visit-my-shop", "1.0 best phone", "1.0\n", "1.0-beta-sale", "9" * 7]
)
def test_a_version_has_no_room_for_words(participant: Participant, client: Client, version: str) -> None:
    submitted = participant.submit(submission_document(app_version=version))
    enrolled = enrol(client, app_version=version)

    for response in (submitted, enrolled):
        assert (response.status_code, response.json()["field"]) == (400, "app_version")


@pytest.mark.parametrize("app", ["", "my app", "<b>", "a" * 33, "0", "visit https://example.org"])
def test_a_program_is_named_by_a_short_identifier(client: Client, db: None, app: str) -> None:
    response = enrol(client, app=app)

    assert (response.status_code, response.json()["field"]) == (400, "app")


def test_there_is_one_policy_with_a_version_of_numbers(db: None, administrator: Client) -> None:
    IntakePolicy.objects.create()
    with pytest.raises(IntegrityError), transaction.atomic():
        IntakePolicy.objects.create(pk=2)
    with pytest.raises(ValidationError):
        IntakePolicy(minimum_app_version="newest").full_clean()
    assert administrator.get(reverse("admin:fronts_intakepolicy_add")).status_code == 403


def test_the_change_is_in_the_rows_history(administrator: Client, front: Any) -> None:
    decide(administrator, accepting="")

    page = administrator.get(reverse("admin:fronts_intakepolicy_history", args=[IntakePolicy.ONLY]))
    assert "keeper" in page.content.decode()
