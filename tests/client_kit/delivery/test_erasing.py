"""Erasing what was sent and what was not: asked for once, and done whenever the server is there."""

import gzip
import json
import time
from typing import Any

import pytest

from client_kit.delivery import enrolment, sending
from client_kit.delivery.server import ProblemError
from client_kit.errors import UsageError
from tests.builders import manifests
from tests.builders.screens import Screen
from tests.client_kit.commands import Terminal
from tests.client_kit.delivery.outbox import Outbox
from tests.client_kit.scripted import Reply, Request, accepted, accepting, problem

OTHER = "http://other.example"


def test_a_request_to_erase_is_kept_until_the_server_has_it(outbox: Outbox, closed_port: int) -> None:
    server = outbox.filled(port=closed_port)
    outbox.deliver()
    server.close()

    enrolment.request_erasure(outbox.home)
    outbox.spool.clear()
    assert outbox.deliver().erased == []
    back = outbox.serve(accepting, closed_port)
    delivered = outbox.deliver()

    assert delivered.erased == [back.url]
    assert back.paths() == ["DELETE /api/v1/me"]
    assert back.requests[0].headers["authorization"] == "Bearer secret"
    assert enrolment.all_enrolments(outbox.home) == []


def test_a_request_to_erase_waits_as_long_as_the_server_asks(outbox: Outbox) -> None:
    refusals = [problem(503, "database_unavailable", Retry_After="600")]

    def answer(request: Request) -> Reply:
        return refusals.pop() if refusals and request.method == "DELETE" else accepting(request)

    server = outbox.filled(answer)
    outbox.deliver()
    enrolment.request_erasure(outbox.home)
    began = time.time()
    assert outbox.deliver().erased == []
    outbox.put(server)

    held = outbox.deliver()

    assert "asks to wait" in held.trouble[server.url]
    paths = server.paths()
    assert (paths.count("DELETE /api/v1/me"), len(server.submissions())) == (1, 1)
    assert outbox.deliver(clock=lambda: began + 700).erased == [server.url]
    assert len(server.submissions()) == 2


def test_erasing_forgets_a_draft(outbox: Outbox) -> None:
    outbox.spool.keep_draft(outbox.serve(accepting).url, manifests.payload())

    assert sending.erase(outbox.spool, outbox.home) == (1, [])

    assert outbox.spool.drafts() == []


@pytest.mark.parametrize("reply", [accepted("accepted"), problem(503, "busy")])
def test_a_session_that_is_erased_while_it_is_sent_is_no_trouble(reply: Reply, outbox: Outbox) -> None:
    def erasing(request: Request) -> Reply:
        if request.path.endswith("/submissions"):
            outbox.spool.clear()
            return reply
        return accepting(request)

    server = outbox.filled(erasing, sessions=2)

    delivered = outbox.deliver()

    assert (delivered.settled, outbox.items()) == ([], [])
    assert len(server.submissions()) == 1


@pytest.fixture
def payload() -> dict[str, Any]:
    """A session of one run."""
    return manifests.payload()


@pytest.fixture
def run(payload: dict[str, Any]) -> str:
    """The id of its run."""
    return str(payload["sessions"][0]["runs"][0]["id"])


def test_a_run_that_is_erased_before_it_is_sent_never_leaves(
    outbox: Outbox, payload: dict[str, Any], run: str
) -> None:
    runs = payload["sessions"][0]["runs"]
    runs.append({**runs[0], "id": "another"})
    server = outbox.serve(accepting)
    item = outbox.put(server, payload)

    assert sending.erase_run(outbox.spool, outbox.home, run) == []
    outbox.deliver()

    [sent] = server.submissions()
    [left] = json.loads(gzip.decompress(sent.body))["sessions"][0]["runs"]
    assert left["id"] == "another"
    assert sent.headers["idempotency-key"] != item.idempotency_key


def test_a_run_stays_here_while_its_server_cannot_be_asked_to_erase_it(
    outbox: Outbox, payload: dict[str, Any], run: str
) -> None:
    server = outbox.serve(accepting)
    item = outbox.put(server, payload)
    outbox.deliver()

    server.answer = lambda _: problem(503, "busy")
    with pytest.raises(ProblemError, match="busy"):
        sending.erase_run(outbox.spool, outbox.home, run)
    assert outbox.spool.payload(item) == payload

    server.answer = lambda _: problem(404, "not_found")  # an answer was lost, it is erased there
    assert sending.erase_run(outbox.spool, outbox.home, run) == []
    assert outbox.items() == []


def test_a_run_is_named_by_its_id_or_the_address_of_its_page_and_takes_its_session_along(
    outbox: Outbox, payload: dict[str, Any], run: str
) -> None:
    outbox.put(OTHER, payload)

    with pytest.raises(UsageError, match="its page's address"):
        sending.erase_run(outbox.spool, outbox.home, "my fastest run")
    sending.erase_run(outbox.spool, outbox.home, f"{OTHER}/runs/{run.upper()}/?front=kfusion-1")

    assert outbox.items() == []


@pytest.mark.parametrize(("answer", "left"), [("no", 1), ("yes", 0)])
def test_the_command_asks_before_it_erases(
    answer: str, left: int, outbox: Outbox, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    outbox.put("http://127.0.0.1:1")
    monkeypatch.setattr("sys.stdin", Screen(answer))

    assert terminal("erase")[0] == 0
    assert len(outbox.items()) == left


def test_without_a_terminal_erasing_takes_an_option(outbox: Outbox, terminal: Terminal) -> None:
    outbox.put("http://127.0.0.1:1")

    code, _, error = terminal("erase")
    assert (code, "add --yes" in error, len(outbox.items())) == (2, True, 1)
    assert terminal("erase", "--yes")[0] == 0
    assert outbox.items() == []
