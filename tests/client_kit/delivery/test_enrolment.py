"""Installations and their tokens: one for each device, renewed without losing what waits."""

import gzip
import json
from typing import Any

import pytest

from client_kit.delivery import enrolment, sending
from client_kit.delivery.server import ProblemError, Server
from client_kit.delivery.spool import Spool
from client_kit.home import Home
from tests.builders import manifests
from tests.client_kit.delivery.answering import Serve, accepted, accepting, submissions
from tests.client_kit.scripted import Reply, Request, problem


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
    item = spool.put(scripted.url, manifests.payload())

    sending.deliver(spool, home)

    assert spool.item(item.id).state == "accepted"
    assert [known.token for known in enrolment.all_enrolments(home)] == ["new"]


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
        number: int = json.loads(body)["consent_version"]
        return number

    scripted = serve(answer)
    before = spool.put(scripted.url, manifests.payload())

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


def test_a_new_token_is_kept_before_the_old_one_ends(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    spool.put(scripted.url, manifests.payload())
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
        spool.put(scripted.url, manifests.payload())
    sending.deliver(spool, home)

    def renewing(request: Request) -> Reply:
        return Reply(201, {"token": "another"}) if request.path.endswith("/token") else Reply(200, {})

    first.answer = last.answer = renewing
    away.answer = lambda _: problem(503, "busy")
    renewed: list[str] = []

    with pytest.raises(ProblemError, match="busy"):
        sending.renew_tokens(home, renewed.append)

    assert sorted(renewed) == sorted([first.url, last.url])
    tokens = {url: enrolment.current_token(home, Server(url)) for url in (first.url, away.url, last.url)}
    assert [url for url, token in tokens.items() if token == "another"] == [first.url, last.url]


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

    item = spool.put(serve(answer).url, manifests.payload())

    delivered = sending.deliver(spool, home)

    assert spool.item(item.id).state == "queued"
    assert "enrol again for a second device" in "\n".join(delivered.lines())
