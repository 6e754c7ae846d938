"""Talking to a server, and to what only looks like one: every outcome has its own type."""

import email.utils
import threading
import time

import pytest

from client_kit.delivery.server import NotFrontrunnerError, ProblemError, Server, UnreachableError
from client_kit.errors import OutdatedError, UsageError
from tests.client_kit.scripted import Reply, Serve, problem

WRONG = (
    "localhost:8000", "ftp://host", "http://", "http://me:secret@host", "http://host/?a=1", "http://host:99999",
    "http://host:port", "http://[::1", "http://a..b", "http://ho st", "http://h/\u00e4",
)  # fmt: skip


@pytest.mark.parametrize("url", WRONG)
def test_a_wrong_address_is_a_usage_error(url: str) -> None:
    with pytest.raises(UsageError, match="--server"):
        Server(url)


def test_an_address_below_a_path_is_kept(serve: Serve) -> None:
    scripted = serve(lambda _: Reply(200, {}))

    server = Server(f"{scripted.url}/front/")
    server.manifest("kfusion")

    assert scripted.paths() == ["GET /front/api/v1/manifest?application=kfusion"]
    assert server.page("devices/x/") == f"{scripted.url}/front/devices/x/"


def test_an_unreachable_server_is_an_error_with_its_address(closed_port: int) -> None:
    with pytest.raises(UnreachableError, match=f"{closed_port} cannot be reached: Connection refused"):
        Server(f"http://127.0.0.1:{closed_port}").enrol(1)


def test_an_answer_that_breaks_off_is_no_answer(serve: Serve) -> None:
    scripted = serve(lambda _: Reply(200, {"items": [1] * 50}, cut=20))

    with pytest.raises(UnreachableError, match="broke off"):
        Server(scripted.url).manifest("kfusion")


def test_a_server_that_never_answers_is_given_up(serve: Serve) -> None:
    released = threading.Event()

    def answer(_: object) -> Reply:
        released.wait(10)
        return Reply(200, {})

    scripted = serve(answer)
    try:
        with pytest.raises(UnreachableError, match="timed out"):
            Server(scripted.url, timeout=0.1).manifest("kfusion")
    finally:
        released.set()


def test_a_redirect_is_named_and_the_token_stays_here(serve: Serve) -> None:
    elsewhere = serve(lambda _: Reply(200, {}))
    scripted = serve(lambda _: Reply(302, {}, (("Location", f"{elsewhere.url}/api/v1/me"),)))

    with pytest.raises(NotFrontrunnerError, match=f"redirects to {elsewhere.url}"):
        Server(scripted.url).erase("secret")

    assert elsewhere.requests == []


def test_a_log_in_page_is_not_a_frontrunner_server(serve: Serve) -> None:
    scripted = serve(lambda _: Reply(200, raw=b"<html>Welcome to our hotel"))
    with pytest.raises(NotFrontrunnerError, match="not JSON"):
        Server(scripted.url).enrol(1)

    scripted.answer = lambda _: Reply(404, raw=b"<html>no")
    with pytest.raises(NotFrontrunnerError, match="404"):
        Server(scripted.url).enrol(1)


def test_a_refusal_carries_its_code_and_reason(serve: Serve) -> None:
    scripted = serve(lambda _: problem(422, "unknown_configuration", "no configuration called fast"))

    with pytest.raises(ProblemError) as raised:
        Server(scripted.url).submit("token", "key", b"body")

    assert (raised.value.status, raised.value.code) == (422, "unknown_configuration")
    assert str(raised.value) == "no configuration called fast (unknown_configuration)"
    assert raised.value.temporary is False
    request = scripted.requests[0]
    assert request.headers["authorization"] == "Bearer token"
    assert request.headers["idempotency-key"] == "key"
    assert request.headers["content-encoding"] == "gzip"
    assert request.body == b"body"


@pytest.mark.parametrize(
    ("value", "seconds"), [("7", 7.0), ("999999999", 86400.0), ("soon", None), ("nan", None)]
)
def test_retry_after_is_read(serve: Serve, value: str, seconds: float | None) -> None:
    scripted = serve(lambda _: problem(429, "too_many_requests", Retry_After=value))

    with pytest.raises(ProblemError) as raised:
        Server(scripted.url).manifest("kfusion")

    assert raised.value.retry_after == seconds
    assert raised.value.temporary


def test_retry_after_may_be_a_date(serve: Serve) -> None:
    later = email.utils.formatdate(time.time() + 120, usegmt=True)
    scripted = serve(lambda _: Reply(503, raw=b"", headers=(("Retry-After", later),)))

    with pytest.raises(ProblemError) as raised:
        Server(scripted.url).manifest("kfusion")

    assert raised.value.retry_after is not None
    assert 60 < raised.value.retry_after <= 120


def test_too_old_a_client_has_its_own_error(serve: Serve) -> None:
    scripted = serve(lambda _: problem(426, "client_too_old", "update to 2.0"))

    with pytest.raises(OutdatedError, match=r"too old for .*: update to 2\.0"):
        Server(scripted.url).enrol(1)
