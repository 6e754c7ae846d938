"""Installations and their tokens: one for each device, renewed without losing what waits."""

import gzip
import json
from typing import Any

import pytest

from client_kit.delivery import enrolment, sending
from client_kit.delivery.server import ProblemError, Server
from tests.builders import manifests
from tests.client_kit.delivery.outbox import Outbox
from tests.client_kit.scripted import Reply, Request, accepted, accepting, always, problem


def tokens(outbox: Outbox) -> list[str]:
    return [known.token for known in enrolment.all_enrolments(outbox.home)]


def test_a_server_that_forgot_this_installation_gets_a_new_one(outbox: Outbox) -> None:
    given = iter(["old", "new"])

    def answer(request: Request) -> Reply:
        if request.path.endswith("/enrol"):
            return Reply(201, {"installation_id": "me", "token": next(given)})
        if request.headers["authorization"] == "Bearer old":
            return problem(401, "invalid_token", "unknown token")
        return accepting(request)

    outbox.filled(answer)

    outbox.deliver()

    assert outbox.states() == ["accepted"]
    assert tokens(outbox) == ["new"]


@pytest.mark.parametrize("refusing", ["/enrol", "/submissions"])
def test_a_newer_consent_text_keeps_what_waits_until_it_is_agreed_to(refusing: str, outbox: Outbox) -> None:
    def version(request: Request) -> int:
        body = request.body if request.path.endswith("/enrol") else gzip.decompress(request.body)
        number: int = json.loads(body)["consent_version"]
        return number

    def answer(request: Request) -> Reply:
        if request.path.endswith(refusing) and version(request) == 1:
            return problem(400, "consent_outdated", "the text is another one")
        return accepting(request)

    server = outbox.filled(answer)
    [before] = outbox.items()

    delivered = outbox.deliver()
    assert outbox.states() == ["queued"]
    assert delivered.trouble[server.url].endswith("(consent_outdated): agree again with `run`")
    sending.renew(outbox.spool, outbox.home, server.url, 2)
    outbox.deliver()

    [after] = outbox.items()
    assert after.state == "accepted"
    assert after.idempotency_key != before.idempotency_key
    sent = server.submissions()[-1]
    assert version(sent) == 2
    assert sent.headers["idempotency-key"] == after.idempotency_key


def test_a_new_token_is_kept_before_the_old_one_ends(outbox: Outbox) -> None:
    server = outbox.filled()
    outbox.deliver()

    def renewing(request: Request) -> Reply:
        if request.path.endswith("/me/token"):
            return Reply(201, {"token": "another"})
        assert enrolment.current_token(outbox.home, Server(server.url)) == "another"
        assert request.headers["authorization"] == "Bearer another"
        return Reply(200, {"sessions": []})

    server.answer = renewing

    assert sending.renew_tokens(outbox.home) == [server.url]
    assert server.paths()[-2:] == ["POST /api/v1/me/token", "GET /api/v1/me/data"]


def test_a_server_that_is_away_keeps_no_other_from_renewing(outbox: Outbox) -> None:
    first, away, last = (outbox.filled() for _ in range(3))
    outbox.deliver()
    first.answer = last.answer = always("/token$", Reply(201, {"token": "another"}), lambda _: Reply(200, {}))
    away.answer = lambda _: problem(503, "busy")
    renewed: list[str] = []

    with pytest.raises(ProblemError, match="busy"):
        sending.renew_tokens(outbox.home, renewed.append)

    assert sorted(renewed) == sorted([first.url, last.url])
    now = [enrolment.current_token(outbox.home, Server(one.url)) for one in (first, away, last)]
    assert now == ["another", "secret", "another"]


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
    payload = manifests.payload()
    return {**payload, "device": {**payload["device"], "model": model}}


def test_each_device_has_an_installation_and_erasing_erases_all_of_them(outbox: Outbox) -> None:
    devices = Devices()
    server = outbox.serve(devices)
    for model in ("first", "second", "first", "second", "second"):
        outbox.put(server, measured_on(model))
        outbox.deliver()

    assert outbox.states() == ["accepted"] * 5
    assert devices.bound == {"token 0": "first", "token 1": "second"}
    assert tokens(outbox) == ["token 1", "token 0"]

    sending.erase(outbox.spool, outbox.home)
    outbox.deliver()

    assert (devices.bound, tokens(outbox)) == ({}, [])


def test_a_session_whose_device_no_installation_may_have_is_kept(outbox: Outbox) -> None:
    changed = problem(409, "device_changed", "enrol again for a second device")
    outbox.filled(always("/submissions$", changed))

    delivered = outbox.deliver()

    assert outbox.states() == ["queued"]
    assert "enrol again for a second device" in "\n".join(delivered.lines())
