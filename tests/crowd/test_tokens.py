"""A token is followed by another without anybody being locked out, and only digests are kept."""

from dataclasses import replace
from typing import Any

from crowd.devices.models import Installation
from tests.crowd.documents import submission_document
from tests.crowd.participant import API, Participant


def renewed(participant: Participant) -> Participant:
    response = participant.client.post(f"{API}/me/token", headers=participant.headers)
    assert response.status_code == 201, response.content
    assert response.headers["Cache-Control"] == "no-store"
    return replace(participant, token=response.json()["token"])


def test_the_new_token_ends_the_old_one_when_it_is_used(participant: Participant) -> None:
    new = renewed(participant)

    assert participant.get("/me/data").status_code == 200
    assert new.submit(submission_document()).status_code == 202
    assert participant.get("/me/data").json()["code"] == "token_invalid"
    assert new.get("/me/data").status_code == 200


def test_an_answer_that_was_lost_locks_nobody_out(participant: Participant) -> None:
    lost = renewed(participant)
    new = renewed(participant)

    assert lost.get("/me/data").status_code == 401
    assert participant.get("/me/data").status_code == 200
    assert new.get("/me/data").status_code == 200


def test_a_revoked_installation_has_no_token_at_all(participant: Participant, installation: Any) -> None:
    new = renewed(participant)
    Installation.objects.filter(pk=installation.pk).update(revoked_at=installation.created_at)

    assert new.get("/me/data").status_code == 401
    assert participant.get("/me/data").status_code == 401


def test_no_token_is_kept(participant: Participant) -> None:
    new = renewed(participant)

    kept = str(vars(Installation.objects.get()))

    assert participant.token not in kept
    assert new.token not in kept


def test_a_token_costs_one_query(participant: Participant, django_assert_num_queries: Any) -> None:
    from crowd.devices.services import installation_of

    with django_assert_num_queries(1):
        assert installation_of(participant.token) is not None
