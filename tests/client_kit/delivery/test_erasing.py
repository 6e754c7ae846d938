"""Erasing what was sent and what was not: asked for once, and done whenever the server is there."""

import gzip
import io
import json
import time

import pytest

from client_kit import __main__ as command_line
from client_kit.delivery import enrolment, sending
from client_kit.delivery.server import ProblemError
from client_kit.delivery.spool import Spool
from client_kit.errors import UsageError
from client_kit.home import Home
from tests.builders import manifests
from tests.client_kit.delivery.answering import Serve, accepted, accepting, submissions
from tests.client_kit.scripted import Reply, Request, problem


def test_a_request_to_erase_is_kept_until_the_server_has_it(
    serve: Serve, home: Home, spool: Spool, closed_port: int
) -> None:
    scripted = serve(accepting, closed_port)
    spool.put(scripted.url, manifests.payload())
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


def test_a_request_to_erase_waits_as_long_as_the_server_asks(serve: Serve, home: Home, spool: Spool) -> None:
    def answer(request: Request) -> Reply:
        if request.method == "DELETE" and len(deletions()) == 1:
            return problem(503, "database_unavailable", Retry_After="600")
        return accepting(request)

    def deletions() -> list[Request]:
        return [request for request in scripted.requests if request.method == "DELETE"]

    scripted = serve(answer)
    spool.put(scripted.url, manifests.payload())
    sending.deliver(spool, home)
    enrolment.request_erasure(home)
    began = time.time()
    assert sending.deliver(spool, home).erased == []
    spool.put(scripted.url, manifests.payload())

    held = sending.deliver(spool, home)

    assert "asks to wait" in held.trouble[scripted.url]
    assert (len(deletions()), len(submissions(scripted))) == (1, 1)
    delivered = sending.deliver(spool, home, clock=lambda: began + 700)
    assert delivered.erased == [scripted.url]
    assert len(submissions(scripted)) == 2


def test_erasing_forgets_a_draft(serve: Serve, home: Home, spool: Spool) -> None:
    spool.keep_draft(serve(accepting).url, manifests.payload())

    assert sending.erase(spool, home) == (1, [])

    assert spool.drafts() == []


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
    spool.put(scripted.url, manifests.payload())
    spool.put(scripted.url, manifests.payload())

    delivered = sending.deliver(spool, home)

    assert delivered.settled == []
    assert spool.items() == []
    assert len(submissions(scripted)) == 1


def test_a_run_that_is_erased_before_it_is_sent_never_leaves(serve: Serve, home: Home, spool: Spool) -> None:
    scripted = serve(accepting)
    payload = manifests.payload()
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
    payload = manifests.payload()
    spool.put("http://other.example", payload)

    sending.erase_run(spool, home, payload["sessions"][0]["runs"][0]["id"])

    assert spool.items() == []


def test_a_run_stays_here_while_its_server_cannot_be_asked_to_erase_it(
    serve: Serve, home: Home, spool: Spool
) -> None:
    scripted = serve(accepting)
    payload = manifests.payload()
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


def test_a_run_is_named_by_its_id_or_the_address_of_its_page(home: Home, spool: Spool) -> None:
    payload = manifests.payload()
    run = payload["sessions"][0]["runs"][0]["id"]
    spool.put("http://other.example", payload)

    with pytest.raises(UsageError, match="its page's address"):
        sending.erase_run(spool, home, "my fastest run")
    sending.erase_run(spool, home, f"http://other.example/runs/{run.upper()}/?front=kfusion-1")

    assert spool.items() == []


@pytest.mark.parametrize(("answer", "left"), [("no", 1), ("yes", 0)])
def test_the_command_asks_before_it_erases(
    home: Home, spool: Spool, monkeypatch: pytest.MonkeyPatch, answer: str, left: int
) -> None:
    spool.put("http://127.0.0.1:1", manifests.payload())
    stdin = io.StringIO(answer)
    stdin.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr("sys.stdin", stdin)
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))

    assert command_line.main(["erase"]) == 0
    assert len(spool.items()) == left


def test_without_a_terminal_erasing_takes_an_option(
    home: Home, spool: Spool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spool.put("http://127.0.0.1:1", manifests.payload())
    monkeypatch.setenv("FRONTRUNNER_HOME", str(home.path))

    assert command_line.main(["erase"]) == 2
    assert "add --yes" in capsys.readouterr().err
    assert len(spool.items()) == 1
    assert command_line.main(["erase", "--yes"]) == 0
    assert spool.items() == []
