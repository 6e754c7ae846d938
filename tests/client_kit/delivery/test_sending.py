"""Sending the spool: each session once, a bad one never in the way of the next, nothing lost on the way."""

import json

import pytest

from groundwork import __version__
from tests.builders import manifests
from tests.client_kit.delivery.outbox import Outbox
from tests.client_kit.scripted import Reply, accepted, accepting, always, at_first, problem

SUBMISSIONS = "/submissions$"


def test_a_session_is_sent_once_and_settled(outbox: Outbox) -> None:
    server = outbox.filled()
    [item] = outbox.items()

    delivered = outbox.deliver()
    outbox.deliver()

    assert server.paths() == ["POST /api/v1/enrol", "POST /api/v1/submissions"]
    enrolled, sent = server.requests
    assert json.loads(enrolled.body) == {
        "app": "client_kit",
        "app_version": __version__,
        "consent_version": 1,
    }
    assert sent.body == outbox.spool.body(item)
    assert sent.headers["idempotency-key"] == item.idempotency_key
    assert delivered.settled == outbox.items()
    [after] = outbox.items()
    assert (after.id, after.state, after.submission_id) == (item.id, "accepted", "submission 1")


def test_a_rejected_session_keeps_its_reason_and_the_next_one_goes(outbox: Outbox) -> None:
    refusal = problem(422, "wrong_frame_count", "12 frames, 100 were asked for")
    server = outbox.filled(at_first(SUBMISSIONS, refusal), sessions=2)

    delivered = outbox.deliver()

    assert outbox.states() == ["rejected", "accepted"]
    assert delivered.settled == outbox.items()
    assert delivered.settled[0].reason == "12 frames, 100 were asked for (wrong_frame_count)"
    outbox.deliver()
    assert len(server.submissions()) == 2


@pytest.mark.parametrize("status", [408, 500])
def test_a_session_that_the_server_cannot_take_waits_alone(outbox: Outbox, status: int) -> None:
    server = outbox.filled(at_first(SUBMISSIONS, problem(status, "failed")), sessions=2)

    delivered = outbox.deliver()

    assert outbox.states() == ["queued", "accepted"]
    assert len(delivered.settled) == 1
    assert delivered.trouble == {server.url: "failed"}
    assert outbox.items()[0].not_before > 0


def test_the_answers_to_the_runs_decide_the_sessions_state(outbox: Outbox) -> None:
    answers = [("accepted", "rejected"), ("duplicate", "duplicate"), ("rejected", "rejected")]
    outbox.filled(at_first(SUBMISSIONS, *(accepted(*states) for states in answers)), sessions=3)

    outbox.deliver()

    rejected = "rejected: why_rejected"
    assert [(item.state, item.reason) for item in outbox.items()] == [
        ("accepted", rejected),
        ("duplicate", None),
        ("rejected", rejected),
    ]


def test_a_server_that_is_down_loses_nothing_and_gets_the_same_bytes_later(
    outbox: Outbox, closed_port: int
) -> None:
    url = f"http://127.0.0.1:{closed_port}"
    items = [outbox.put(url) for _ in range(2)]

    delivered = outbox.deliver()
    assert delivered.settled == []
    first, second = delivered.lines()
    assert first == f"Not sent: {url} cannot be reached: Connection refused"
    assert "stored on this device" in second
    assert outbox.states() == ["queued", "queued"]
    assert outbox.items()[1].attempts == 0  # one attempt was enough

    server = outbox.serve(accepting, closed_port)
    outbox.deliver()

    keys = [request.headers["idempotency-key"] for request in server.submissions()]
    assert keys == [item.idempotency_key for item in items]
    assert outbox.states() == ["accepted", "accepted"]


def test_one_server_in_trouble_does_not_hold_up_another(outbox: Outbox, closed_port: int) -> None:
    outbox.put(f"http://127.0.0.1:{closed_port}")
    outbox.filled()

    outbox.deliver()

    assert outbox.states() == ["queued", "accepted"]


def test_an_answer_that_is_lost_leads_to_the_same_request_again(outbox: Outbox) -> None:
    cut = Reply(202, {"submission_id": "1", "items": []}, cut=5)
    server = outbox.filled(at_first(SUBMISSIONS, cut))

    outbox.deliver()
    assert outbox.states() == ["queued"]
    outbox.deliver()

    first, second = server.submissions()
    assert first.body == second.body
    assert first.headers["idempotency-key"] == second.headers["idempotency-key"]
    assert outbox.states() == ["accepted"]


def test_a_server_that_asks_to_wait_is_left_alone_until_then(outbox: Outbox) -> None:
    busy = problem(429, "too_many_requests", Retry_After="86400")
    server = outbox.filled(at_first(SUBMISSIONS, busy))
    outbox.deliver()
    [item] = outbox.items()
    assert (item.state, item.asked_to_wait) == ("queued", True)

    outbox.deliver()
    assert len(server.submissions()) == 1
    outbox.deliver(clock=lambda: item.not_before + 1)

    assert outbox.states() == ["accepted"]


def test_what_one_session_was_asked_to_wait_holds_for_its_server(outbox: Outbox) -> None:
    busy = problem(429, "too_many_requests", Retry_After="600")
    server = outbox.filled(always(SUBMISSIONS, busy), sessions=2)
    outbox.deliver()

    later = outbox.put(server)
    other = outbox.filled()
    outbox.deliver()

    assert len(server.submissions()) == 1
    assert outbox.spool.item(later.id).state == "queued"
    assert len(other.submissions()) == 1


def test_a_hotels_log_in_page_rejects_nothing(outbox: Outbox) -> None:
    outbox.filled(lambda _: Reply(403, raw=b"<html>Please log in"))

    outbox.deliver()

    assert outbox.states() == ["queued"]


def test_a_client_that_is_too_old_keeps_its_sessions(outbox: Outbox) -> None:
    outbox.filled(lambda _: problem(426, "client_too_old", "update"))

    delivered = outbox.deliver()

    assert delivered.outdated is not None
    assert outbox.states() == ["queued"]


def test_while_another_process_sends_nothing_is_sent_twice(outbox: Outbox) -> None:
    server = outbox.filled()

    with outbox.home.only_one("delivery") as alone:
        delivered = outbox.deliver()

    assert (alone, delivered.busy, server.requests) == (True, True, [])


def test_a_draft_is_sent_once_and_only_when_nobody_measures_any_more(outbox: Outbox) -> None:
    server, spool = outbox.serve(accepting), outbox.spool
    spool.keep_draft(server.url, manifests.payload())
    [draft] = spool.drafts()

    with outbox.home.only_one("measurement") as alone:
        outbox.deliver()
    assert alone
    assert (server.requests, spool.drafts()) == ([], [draft])
    outbox.deliver()
    outbox.deliver()

    [sent] = server.submissions()
    assert sent.headers["idempotency-key"] == draft.idempotency_key
    assert spool.item(draft.id).state == "accepted"
