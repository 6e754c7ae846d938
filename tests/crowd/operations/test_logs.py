"""What is logged of requests and tasks: enough to find what happened, nothing of who asked."""

import json
import logging
from collections.abc import Callable
from typing import Any

import pytest
from django.test import Client

from crowd.observability import logs
from crowd.results.privacy.own_page import own_page_path
from tests.builders.documents import submission_document
from tests.builders.participant import API, Participant

REQUESTS = "crowd.requests"


def record(message: str, **more: object) -> logging.LogRecord:
    made = logging.LogRecord("crowd.test", logging.WARNING, __file__, 1, message, None, None)
    made.__dict__.update(logs.fields(**more))
    return made


@pytest.fixture
def lines(caplog: pytest.LogCaptureFixture) -> Callable[[], list[dict[str, Any]]]:
    """What was logged so far, as the JSON lines that a program would read."""
    caplog.handler.setFormatter(logs.JsonFormatter())
    caplog.set_level(logging.DEBUG)
    return lambda: [json.loads(line) for line in caplog.text.splitlines()]


def test_a_chosen_request_id_comes_back_and_is_logged(client: Client, db: None, lines: Any) -> None:
    answer = client.get(f"{API}/devices", headers={"X-Request-ID": "proxy-4711"})

    assert answer.headers["X-Request-ID"] == "proxy-4711"
    (line,) = [line for line in lines() if line["logger"] == REQUESTS]
    assert line["request_id"] == "proxy-4711"
    assert line["message"] == "GET /api/v1/devices 200"
    assert line["ms"] > 0


@pytest.mark.parametrize("chosen", ["", "short", "a" * 65, "forged line\n{}", "<script>alert</script>"])
def test_an_id_that_could_harm_the_log_is_replaced(client: Client, db: None, chosen: str) -> None:
    first, second = (
        client.get("/healthz", headers={"X-Request-ID": chosen}).headers["X-Request-ID"] for _ in range(2)
    )

    assert first != chosen
    assert len({first, second}) == 2


def test_a_line_holds_neither_address_nor_token_nor_query(participant: Participant, lines: Any) -> None:
    answer = participant.submit(submission_document(), REMOTE_ADDR="192.0.2.77").json()
    participant.get(f"/submissions/{answer['submission_id']}?who=somebody")
    participant.client.get("/no/such/page/of/somebody")

    written = json.dumps(lines())
    assert "GET /api/v1/submissions/<uuid:key> 200" in written
    assert "GET /unmatched 404" in written
    for private in (participant.token, answer["submission_id"], "somebody", "192.0.2.77", "127.0.0.1"):
        assert private not in written


def test_a_failing_secret_page_is_logged_by_its_pattern(
    front: Any, installation: Any, monkeypatch: pytest.MonkeyPatch, lines: Any
) -> None:
    path = own_page_path(installation)
    monkeypatch.setattr("crowd.dashboard.views.private_page.own_page", lambda _: 1 // 0)
    client = Client(raise_request_exception=False, enforce_csrf_checks=True)

    failed, refused = client.get(path), client.post(path)

    assert (failed.status_code, refused.status_code) == (500, 403)
    logged = [line for line in lines() if line["logger"].startswith("django.")]
    assert "Internal Server Error: /mine/<str:signed>/" in [line["message"] for line in logged]
    assert "Forbidden (CSRF cookie not set.): /mine/<str:signed>/" in [line["message"] for line in logged]
    assert "ZeroDivisionError" in json.dumps(logged)
    assert path.split("/")[2] not in json.dumps(lines())


def test_those_who_watch_are_logged_only_for_debugging(client: Client, db: None, lines: Any) -> None:
    client.get("/healthz")

    assert [line["level"] for line in lines() if line["logger"] == REQUESTS] == ["DEBUG"]


def test_json_lines_are_one_line_with_time_level_and_traceback() -> None:
    try:
        raise ValueError("first\nsecond")
    except ValueError as error:
        made = record("it failed", device="none")
        made.exc_info = (ValueError, error, error.__traceback__)
    line = logs.JsonFormatter().format(made)

    assert "\n" not in line
    entry = json.loads(line)
    assert (entry["level"], entry["logger"], entry["message"]) == ("WARNING", "crowd.test", "it failed")
    assert entry["device"] == "none"
    assert entry["time"].endswith("+00:00")
    assert "ValueError: first\nsecond" in entry["exception"]


def test_text_lines_end_with_what_was_added() -> None:
    token = logs.request_id.set("abcdefgh")
    try:
        line = logs.TextFormatter().format(record("it went", ms=3))
    finally:
        logs.request_id.reset(token)

    assert line.endswith("WARNING crowd.test it went request_id=abcdefgh ms=3")
