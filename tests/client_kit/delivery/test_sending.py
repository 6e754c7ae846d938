"""Sending the spool: each session once, a bad one never in the way of the next, nothing lost on the way."""

from typing import Any

import pytest

from client_kit.delivery import sending
from client_kit.delivery.spool import Spool
from client_kit.home import Home
from frontrunner import __version__
from tests.builders import manifests
from tests.client_kit.delivery.answering import Serve, accepted, accepting, submissions
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem


def test_a_session_is_sent_once_and_settled(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    item = spool.put(scripted.url, manifests.payload())

    delivered = sending.deliver(spool, home)
    sending.deliver(spool, home)

    assert scripted.paths() == ["POST /api/v1/enrol", "POST /api/v1/submissions"]
    enrolled, sent = scripted.requests
    assert enrolled.body == (
        f'{{"app": "client_kit", "app_version": "{__version__}", "consent_version": 1}}'.encode()
    )
    assert sent.body == spool.body(item)
    assert sent.headers["idempotency-key"] == item.idempotency_key
    after = spool.item(item.id)
    assert delivered.settled == [after]
    assert (after.state, after.submission_id) == ("accepted", "submission 1")


def test_a_rejected_session_keeps_its_reason_and_the_next_one_goes(
    serve: Serve, home: Home, spool: Spool
) -> None:
    def answer(request: Request) -> Reply:
        if len(submissions(scripted)) == 1 and request.path.endswith("/submissions"):
            return problem(422, "wrong_frame_count", "12 frames, 100 were asked for")
        return accepting(request)

    scripted = serve(answer)
    bad, good = (spool.put(scripted.url, manifests.payload()) for _ in range(2))

    delivered = sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["rejected", "accepted"]
    assert spool.item(bad.id).reason == "12 frames, 100 were asked for (wrong_frame_count)"
    assert [item.id for item in delivered.settled] == [bad.id, good.id]
    sending.deliver(spool, home)
    assert len(submissions(scripted)) == 2


@pytest.mark.parametrize("status", [408, 500])
def test_a_session_that_the_server_cannot_take_waits_alone(
    serve: Serve, home: Home, spool: Spool, status: int
) -> None:
    def answer(request: Request) -> Reply:
        key = request.headers.get("idempotency-key")
        return problem(status, "failed", "") if key == old.idempotency_key else accepting(request)

    scripted = serve(answer)
    old, _ = (spool.put(scripted.url, manifests.payload()) for _ in range(2))

    delivered = sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["queued", "accepted"]
    assert len(delivered.settled) == 1
    assert delivered.trouble == {scripted.url: "failed"}
    assert spool.item(old.id).not_before > 0


def test_the_answers_to_the_runs_decide_the_sessions_state(serve: Serve, home: Home, spool: Spool) -> None:
    answers = [("accepted", "rejected"), ("duplicate", "duplicate"), ("rejected", "rejected")]
    scripted: ScriptedServer = serve(
        lambda request: (
            accepting(request)
            if request.path.endswith("/enrol")
            else accepted(*answers[len(submissions(scripted)) - 1])
        )
    )
    for _ in answers:
        spool.put(scripted.url, manifests.payload())

    sending.deliver(spool, home)

    states = [(item.state, item.reason) for item in spool.items()]
    rejected = "rejected: why_rejected"
    assert states == [("accepted", rejected), ("duplicate", None), ("rejected", rejected)]


def test_a_server_that_is_down_loses_nothing_and_gets_the_same_bytes_later(
    serve: Serve, home: Home, spool: Spool, closed_port: int
) -> None:
    url = f"http://127.0.0.1:{closed_port}"
    items = [spool.put(url, manifests.payload()) for _ in range(2)]

    delivered = sending.deliver(spool, home)
    assert delivered.settled == []
    assert "cannot be reached" in delivered.trouble[url]
    assert [item.state for item in spool.items()] == ["queued", "queued"]
    assert spool.items()[1].attempts == 0  # one attempt was enough

    scripted = serve(accepting, closed_port)
    sending.deliver(spool, home)

    assert [request.headers["idempotency-key"] for request in submissions(scripted)] == [
        item.idempotency_key for item in items
    ]
    assert {item.state for item in spool.items()} == {"accepted"}


def test_one_server_in_trouble_does_not_hold_up_another(
    serve: Serve, home: Home, spool: Spool, closed_port: int
) -> None:
    scripted = serve(accepting)
    spool.put(f"http://127.0.0.1:{closed_port}", manifests.payload())
    spool.put(scripted.url, manifests.payload())

    sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["queued", "accepted"]


def test_an_answer_that_is_lost_leads_to_the_same_request_again(
    serve: Serve, home: Home, spool: Spool
) -> None:
    def answer(request: Request) -> Reply:
        if request.path.endswith("/submissions") and len(submissions(scripted)) == 1:
            return Reply(202, {"submission_id": "1", "items": []}, cut=5)
        return accepting(request)

    scripted = serve(answer)
    item = spool.put(scripted.url, manifests.payload())

    sending.deliver(spool, home)
    assert spool.item(item.id).state == "queued"
    sending.deliver(spool, home)

    first, second = submissions(scripted)
    assert first.body == second.body
    assert first.headers["idempotency-key"] == second.headers["idempotency-key"]
    assert spool.item(item.id).state == "accepted"


def test_a_server_that_asks_to_wait_is_left_alone_until_then(serve: Serve, home: Home, spool: Spool) -> None:
    def answer(request: Request) -> Reply:
        if request.path.endswith("/submissions") and len(submissions(scripted)) == 1:
            return problem(429, "too_many_requests", Retry_After="86400")
        return accepting(request)

    scripted = serve(answer)
    item = spool.put(scripted.url, manifests.payload())
    sending.deliver(spool, home)
    assert (spool.item(item.id).state, spool.item(item.id).asked_to_wait) == ("queued", True)

    sending.deliver(spool, home)
    assert len(submissions(scripted)) == 1
    later = spool.item(item.id).not_before + 1
    sending.deliver(spool, home, clock=lambda: later)

    assert spool.item(item.id).state == "accepted"


def test_a_hotels_log_in_page_rejects_nothing(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(lambda _: Reply(403, raw=b"<html>Please log in"))
    item = spool.put(scripted.url, manifests.payload())

    sending.deliver(spool, home)

    assert spool.item(item.id).state == "queued"


def test_a_client_that_is_too_old_keeps_its_sessions(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(lambda _: problem(426, "client_too_old", "update"))
    item = spool.put(scripted.url, manifests.payload())

    delivered = sending.deliver(spool, home)

    assert delivered.outdated is not None
    assert spool.item(item.id).state == "queued"


def test_while_another_process_sends_nothing_is_sent_twice(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    spool.put(scripted.url, manifests.payload())

    with home.only_one("delivery") as alone:
        delivered = sending.deliver(spool, home)

    assert alone
    assert delivered.busy
    assert scripted.requests == []


def test_a_draft_is_sent_once_and_only_when_nobody_measures_any_more(
    serve: Serve, home: Home, spool: Spool
) -> None:
    scripted = serve(accepting)
    spool.keep_draft(scripted.url, manifests.payload())
    [draft] = spool.drafts()

    with home.only_one("measurement") as alone:
        sending.deliver(spool, home)
    assert alone
    assert (scripted.requests, spool.drafts()) == ([], [draft])
    sending.deliver(spool, home)
    sending.deliver(spool, home)

    [sent] = submissions(scripted)
    assert sent.headers["idempotency-key"] == draft.idempotency_key
    assert spool.item(draft.id).state == "accepted"


def test_the_outcome_of_sending_is_reported_in_plain_lines(
    home: Home, spool: Spool, closed_port: int
) -> None:
    url = f"http://127.0.0.1:{closed_port}"
    spool.put(url, manifests.payload())

    lines: list[Any] = sending.deliver(spool, home).lines()

    assert lines[0] == f"Not sent: {url} cannot be reached: Connection refused"
    assert "stored on this device" in lines[1]


def test_what_one_session_was_asked_to_wait_holds_for_its_server(
    serve: Serve, home: Home, spool: Spool
) -> None:
    scripted = serve(
        lambda request: (
            problem(429, "too_many_requests", Retry_After="600")
            if request.path.endswith("/submissions")
            else accepting(request)
        )
    )
    other = serve(accepting)
    spool.put(scripted.url, manifests.payload())
    spool.put(scripted.url, manifests.payload())
    sending.deliver(spool, home)

    later = spool.put(scripted.url, manifests.payload())
    spool.put(other.url, manifests.payload())
    sending.deliver(spool, home)

    assert len(submissions(scripted)) == 1
    assert spool.item(later.id).state == "queued"
    assert len(submissions(other)) == 1
