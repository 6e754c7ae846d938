"""Sending the spool: each session once, a bad one never in the way of the next, nothing lost on the way."""

import gzip
import json
import time
from collections.abc import Callable
from typing import Any

import pytest

from client_kit.delivery import enrolment, sending
from client_kit.delivery.server import ProblemError, Server
from client_kit.delivery.spool import Spool
from client_kit.errors import UsageError
from client_kit.home import Home
from frontrunner import __version__
from tests.client_kit import documents
from tests.client_kit.scripted import Reply, Request, ScriptedServer, problem

Serve = Callable[..., ScriptedServer]


def accepting(request: Request) -> Reply:
    """Enrols everybody and accepts everything."""
    if request.path.endswith("/enrol"):
        return Reply(201, {"installation_id": "me", "token": "secret"})
    if request.method == "DELETE":
        return Reply(204, raw=b"")
    return accepted("accepted")


def accepted(*states: str) -> Reply:
    items = [{"id": "a run", "status": state, "code": f"why_{state}" if state == "rejected" else None}
             for state in states]  # fmt: skip
    return Reply(202, {"submission_id": "submission 1", "items": items})


def submissions(scripted: ScriptedServer) -> list[Request]:
    return [request for request in scripted.requests if request.path.endswith("/submissions")]


def test_a_session_is_sent_once_and_settled(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    item = spool.put(scripted.url, documents.payload())

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
    bad, good = (spool.put(scripted.url, documents.payload()) for _ in range(2))

    delivered = sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["rejected", "accepted"]
    assert spool.item(bad.id).reason == "12 frames, 100 were asked for (wrong_frame_count)"
    assert [item.id for item in delivered.settled] == [bad.id, good.id]
    sending.deliver(spool, home)
    assert len(submissions(scripted)) == 2


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
        spool.put(scripted.url, documents.payload())

    sending.deliver(spool, home)

    states = [(item.state, item.reason) for item in spool.items()]
    rejected = "rejected: why_rejected"
    assert states == [("accepted", rejected), ("duplicate", None), ("rejected", rejected)]


def test_a_server_that_is_down_loses_nothing_and_gets_the_same_bytes_later(
    serve: Serve, home: Home, spool: Spool, closed_port: int
) -> None:
    url = f"http://127.0.0.1:{closed_port}"
    items = [spool.put(url, documents.payload()) for _ in range(2)]

    delivered = sending.deliver(spool, home)
    assert delivered.settled == []
    assert "cannot be reached" in delivered.trouble[url]
    assert [item.state for item in spool.items()] == ["queued", "queued"]
    assert spool.items()[1].attempts == 0  # one attempt told enough

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
    spool.put(f"http://127.0.0.1:{closed_port}", documents.payload())
    spool.put(scripted.url, documents.payload())

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
    item = spool.put(scripted.url, documents.payload())

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
            return problem(429, "too_many_requests", Retry_After="600")
        return accepting(request)

    scripted = serve(answer)
    item = spool.put(scripted.url, documents.payload())
    sending.deliver(spool, home)

    sending.deliver(spool, home)
    assert len(submissions(scripted)) == 1
    later = spool.item(item.id).not_before + 1
    sending.deliver(spool, home, clock=lambda: later)

    assert spool.item(item.id).state == "accepted"


def test_a_hotels_log_in_page_rejects_nothing(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(lambda _: Reply(403, raw=b"<html>Please log in"))
    item = spool.put(scripted.url, documents.payload())

    sending.deliver(spool, home)

    assert spool.item(item.id).state == "queued"


def test_a_client_that_is_too_old_keeps_its_sessions(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(lambda _: problem(426, "client_too_old", "update"))
    item = spool.put(scripted.url, documents.payload())

    delivered = sending.deliver(spool, home)

    assert delivered.outdated is not None
    assert spool.item(item.id).state == "queued"


def test_a_server_that_forgot_this_installation_gets_a_new_one(
    serve: Serve, home: Home, spool: Spool
) -> None:
    tokens = iter(["old", "new"])

    def answer(request: Request) -> Reply:
        if request.path.endswith("/enrol"):
            return Reply(201, {"installation_id": "me", "token": next(tokens)})
        if request.headers["authorization"] == "Bearer old":
            return problem(401, "invalid_token", "unknown token")
        return accepting(request)

    scripted = serve(answer)
    item = spool.put(scripted.url, documents.payload())

    sending.deliver(spool, home)

    assert spool.item(item.id).state == "accepted"
    assert [known.token for known in enrolment.all_enrolments(home)] == ["new"]


def test_a_request_to_erase_is_kept_until_the_server_has_it(
    serve: Serve, home: Home, spool: Spool, closed_port: int
) -> None:
    scripted = serve(accepting, closed_port)
    spool.put(scripted.url, documents.payload())
    sending.deliver(spool, home)
    scripted.close()

    enrolment.request_erasure(home)
    spool.clear()
    assert sending.deliver(spool, home).erased == []
    back = serve(accepting, closed_port)
    delivered = sending.deliver(spool, home)

    assert delivered.erased == [back.url]
    assert back.paths() == ["DELETE /api/v1/me"]
    assert back.requests[0].headers["authorization"] == "Bearer secret"
    assert enrolment.all_enrolments(home) == []


def test_while_another_process_sends_nothing_is_sent_twice(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    spool.put(scripted.url, documents.payload())

    with home.only_one("delivery") as alone:
        delivered = sending.deliver(spool, home)

    assert alone
    assert delivered.busy
    assert scripted.requests == []


def test_a_draft_is_sent_once_and_only_when_nobody_measures_any_more(
    serve: Serve, home: Home, spool: Spool
) -> None:
    scripted = serve(accepting)
    spool.keep_draft(scripted.url, documents.payload())
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


def test_erasing_forgets_a_draft(serve: Serve, home: Home, spool: Spool) -> None:
    spool.keep_draft(serve(accepting).url, documents.payload())

    assert sending.erase(spool, home) == (1, [])

    assert spool.drafts() == []


def test_what_became_of_the_sessions_is_told_in_plain_lines(
    home: Home, spool: Spool, closed_port: int
) -> None:
    url = f"http://127.0.0.1:{closed_port}"
    spool.put(url, documents.payload())

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
    spool.put(scripted.url, documents.payload())
    spool.put(scripted.url, documents.payload())
    sending.deliver(spool, home)

    later = spool.put(scripted.url, documents.payload())
    spool.put(other.url, documents.payload())
    sending.deliver(spool, home)

    assert len(submissions(scripted)) == 1
    assert spool.item(later.id).state == "queued"
    assert len(submissions(other)) == 1


def test_a_request_to_erase_waits_as_long_as_the_server_asks(serve: Serve, home: Home, spool: Spool) -> None:
    def answer(request: Request) -> Reply:
        if request.method == "DELETE" and len(deletions()) == 1:
            return problem(503, "database_unavailable", Retry_After="600")
        return accepting(request)

    def deletions() -> list[Request]:
        return [request for request in scripted.requests if request.method == "DELETE"]

    scripted = serve(answer)
    spool.put(scripted.url, documents.payload())
    sending.deliver(spool, home)
    enrolment.request_erasure(home)
    began = time.time()
    assert sending.deliver(spool, home).erased == []
    spool.put(scripted.url, documents.payload())

    held = sending.deliver(spool, home)

    assert "asks to wait" in held.trouble[scripted.url]
    assert (len(deletions()), len(submissions(scripted))) == (1, 1)
    delivered = sending.deliver(spool, home, clock=lambda: began + 700)
    assert delivered.erased == [scripted.url]
    assert len(submissions(scripted)) == 2


@pytest.mark.parametrize("refusing", ["/enrol", "/submissions"])
def test_a_newer_consent_text_keeps_what_waits_until_it_is_agreed_to(
    refusing: str, serve: Serve, home: Home, spool: Spool
) -> None:
    def answer(request: Request) -> Reply:
        if request.path.endswith(refusing) and version(request) == 1:
            return problem(400, "consent_outdated", "the text is another one")
        return accepting(request)

    def version(request: Request) -> int:
        body = request.body if request.path.endswith("/enrol") else gzip.decompress(request.body)
        told: int = json.loads(body)["consent_version"]
        return told

    scripted = serve(answer)
    before = spool.put(scripted.url, documents.payload())

    delivered = sending.deliver(spool, home)
    assert spool.item(before.id).state == "queued"
    assert delivered.trouble[scripted.url].endswith("(consent_outdated): agree again with `run`")
    sending.renew(spool, home, scripted.url, 2)
    sending.deliver(spool, home)

    after = spool.item(before.id)
    assert after.state == "accepted"
    assert after.idempotency_key != before.idempotency_key
    assert version(submissions(scripted)[-1]) == 2
    assert submissions(scripted)[-1].headers["idempotency-key"] == after.idempotency_key


@pytest.mark.parametrize("reply", [accepted("accepted"), problem(503, "busy")])
def test_a_session_that_is_erased_while_it_is_sent_is_no_trouble(
    reply: Reply, serve: Serve, home: Home, spool: Spool
) -> None:
    def erasing(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            spool.clear()
            return reply
        return accepting(request)

    scripted = serve(erasing)
    spool.put(scripted.url, documents.payload())
    spool.put(scripted.url, documents.payload())

    delivered = sending.deliver(spool, home)

    assert delivered.settled == []
    assert spool.items() == []
    assert len(submissions(scripted)) == 1


def test_a_run_that_is_erased_before_it_is_sent_never_leaves(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    payload = documents.payload()
    [run] = payload["sessions"][0]["runs"]
    payload["sessions"][0]["runs"].append({**run, "id": "another"})
    item = spool.put(scripted.url, payload)

    assert sending.erase_run(spool, home, run["id"]) == []
    sending.deliver(spool, home)

    [sent] = submissions(scripted)
    [left] = json.loads(gzip.decompress(sent.body))["sessions"][0]["runs"]
    assert left["id"] == "another"
    assert sent.headers["idempotency-key"] != item.idempotency_key


def test_a_session_goes_with_its_last_run(home: Home, spool: Spool) -> None:
    payload = documents.payload()
    spool.put("http://other.example", payload)

    sending.erase_run(spool, home, payload["sessions"][0]["runs"][0]["id"])

    assert spool.items() == []


def test_a_run_stays_here_while_its_server_cannot_be_asked_to_erase_it(
    serve: Serve, home: Home, spool: Spool
) -> None:
    scripted = serve(accepting)
    payload = documents.payload()
    run = payload["sessions"][0]["runs"][0]["id"]
    item = spool.put(scripted.url, payload)
    sending.deliver(spool, home)

    scripted.answer = lambda _: problem(503, "busy")
    with pytest.raises(ProblemError, match="busy"):
        sending.erase_run(spool, home, run)
    assert spool.payload(item) == payload

    scripted.answer = lambda _: problem(404, "not_found")  # an answer was lost, it is erased there
    assert sending.erase_run(spool, home, run) == []
    assert spool.items() == []


def test_a_new_token_is_kept_before_the_old_one_ends(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    spool.put(scripted.url, documents.payload())
    sending.deliver(spool, home)

    def renewing(request: Request) -> Reply:
        if request.path.endswith("/me/token"):
            return Reply(201, {"token": "another"})
        assert enrolment.current_token(home, Server(scripted.url)) == "another"
        assert request.headers["authorization"] == "Bearer another"
        return Reply(200, {"sessions": []})

    scripted.answer = renewing

    assert sending.renew_tokens(home) == [scripted.url]
    assert scripted.paths()[-2:] == ["POST /api/v1/me/token", "GET /api/v1/me/data"]


def test_a_server_that_is_away_keeps_no_other_from_renewing(serve: Serve, home: Home, spool: Spool) -> None:
    first, away, last = (serve(accepting) for _ in range(3))
    for scripted in (first, away, last):
        spool.put(scripted.url, documents.payload())
    sending.deliver(spool, home)

    def renewing(request: Request) -> Reply:
        return Reply(201, {"token": "another"}) if request.path.endswith("/token") else Reply(200, {})

    first.answer = last.answer = renewing
    away.answer = lambda _: problem(503, "busy")
    told: list[str] = []

    with pytest.raises(ProblemError, match="busy"):
        sending.renew_tokens(home, told.append)

    assert sorted(told) == sorted([first.url, last.url])
    tokens = {url: enrolment.current_token(home, Server(url)) for url in (first.url, away.url, last.url)}
    assert [url for url, token in tokens.items() if token == "another"] == [first.url, last.url]


def test_a_run_is_named_by_its_id_or_the_address_of_its_page(home: Home, spool: Spool) -> None:
    payload = documents.payload()
    run = payload["sessions"][0]["runs"][0]["id"]
    spool.put("http://other.example", payload)

    with pytest.raises(UsageError, match="its page's address"):
        sending.erase_run(spool, home, "my fastest run")
    sending.erase_run(spool, home, f"http://other.example/runs/{run.upper()}/?front=kfusion-1")

    assert spool.items() == []


class Devices:
    """A server that binds each installation to the device of its first session."""

    def __init__(self) -> None:
        self.bound: dict[str, str | None] = {}

    def __call__(self, request: Request) -> Reply:
        if request.path.endswith("/enrol"):
            token = f"token {len(self.bound)}"
            self.bound[token] = None
            return Reply(201, {"installation_id": f"id of {token}", "token": token})
        token = request.headers["authorization"].removeprefix("Bearer ")
        if request.method == "DELETE":
            del self.bound[token]
            return Reply(204, raw=b"")
        model = json.loads(gzip.decompress(request.body))["device"]["model"]
        if self.bound[token] not in (None, model):
            return problem(409, "device_changed", "enrol again for a second device")
        self.bound[token] = model
        return accepted("accepted")


def measured_on(model: str) -> dict[str, Any]:
    payload = documents.payload()
    return {**payload, "device": {**payload["device"], "model": model}}


def test_each_device_that_uses_the_folder_has_its_own_installation(
    serve: Serve, home: Home, spool: Spool
) -> None:
    devices = Devices()
    scripted = serve(devices)
    for model in ("first", "second", "first", "second", "second"):
        spool.put(scripted.url, measured_on(model))
        sending.deliver(spool, home)

    assert [item.state for item in spool.items()] == ["accepted"] * 5
    assert devices.bound == {"token 0": "first", "token 1": "second"}
    assert [known.token for known in enrolment.all_enrolments(home)] == ["token 1", "token 0"]


def test_erasing_erases_the_installations_of_all_devices(serve: Serve, home: Home, spool: Spool) -> None:
    devices = Devices()
    scripted = serve(devices)
    for model in ("first", "second"):
        spool.put(scripted.url, measured_on(model))
    sending.deliver(spool, home)

    sending.erase(spool, home)
    sending.deliver(spool, home)

    assert devices.bound == {}
    assert enrolment.all_enrolments(home) == []


def test_a_session_whose_device_no_installation_may_have_is_kept(
    serve: Serve, home: Home, spool: Spool
) -> None:
    def answer(request: Request) -> Reply:
        if request.path.endswith("/enrol"):
            return accepting(request)
        return problem(409, "device_changed", "enrol again for a second device")

    item = spool.put(serve(answer).url, documents.payload())

    delivered = sending.deliver(spool, home)

    assert spool.item(item.id).state == "queued"
    assert "enrol again for a second device" in "\n".join(delivered.lines())


def test_a_day_that_is_used_up_keeps_the_session_for_the_next(serve: Serve, home: Home, spool: Spool) -> None:
    now = time.time()
    full = [True]

    def answer(request: Request) -> Reply:
        if request.path.endswith("/submissions") and full:
            full.pop()
            return problem(429, "daily_limit", "keep the results", **{"Retry-After": "86400"})
        return accepting(request)

    item = spool.put(serve(answer).url, documents.payload())
    sending.deliver(spool, home, clock=lambda: now)
    assert (spool.item(item.id).state, spool.item(item.id).asked_to_wait) == ("queued", True)

    sending.deliver(spool, home, clock=lambda: now + 86_500)

    assert spool.item(item.id).state == "accepted"
