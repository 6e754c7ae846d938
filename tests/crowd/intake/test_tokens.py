"""A token is followed by another without anybody being locked out, and only digests are kept."""

from dataclasses import replace
from typing import Any

from crowd.devices.models import Installation
from tests.builders.documents import session_document, submission_document
from tests.builders.participant import API, Participant


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


def test_a_revoked_token_reads_and_erases_what_it_sent_and_does_nothing_else(
    participant: Participant, installation: Any
) -> None:
    session = session_document()
    key = participant.submit(submission_document(session)).json()["submission_id"]
    new = renewed(participant)
    Installation.objects.filter(pk=installation.pk).update(revoked_at=installation.created_at)

    for each in (participant, new):
        refused = [
            each.submit(submission_document()),
            each.submit(submission_document(), path="/submissions:validate"),
            each.get(f"/submissions/{key}"),
            each.client.post(f"{API}/me/token", headers=each.headers),
        ]
        assert [(answer.status_code, answer.json()["code"]) for answer in refused] == [
            (401, "token_invalid")
        ] * 4
    assert [row["id"] for row in new.own_data()["sessions"]] == [session["id"]]
    assert new.delete(f"/me/runs/{session['runs'][0]['id']}").status_code == 204
    assert new.delete("/me").status_code == 204
    assert not Installation.objects.exists()
    assert new.get("/me/data").json()["code"] == "token_invalid"


def test_no_token_is_kept(participant: Participant) -> None:
    new = renewed(participant)

    kept = str(vars(Installation.objects.get()))

    assert participant.token not in kept
    assert new.token not in kept


def test_a_token_costs_one_query(participant: Participant, django_assert_num_queries: Any) -> None:
    from crowd.devices.services import installation_of

    with django_assert_num_queries(1):
        assert installation_of(participant.token) is not None
