"""What Django is given of an ASGI request, and what becomes of its answer."""

import asyncio
import io
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from django.db import OperationalError
from django.http import FileResponse, HttpResponse, HttpResponseBase, StreamingHttpResponse
from django.test import Client

from crowd.fronts.content.front_file import LARGEST_FILE_BYTES
from crowd.http import asgi_handler
from crowd.http.asgi_handler import Handler, wsgi_environ
from crowd.http.middleware import BODY_REFUSAL
from crowd.http.problems import Problem

Full = tuple[Handler, threading.Event, list[str]]


@pytest.fixture(autouse=True)
def ended_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The threads of a handler end with its test."""
    pools: list[ThreadPoolExecutor] = []

    def pool(*arguments: Any, **options: Any) -> ThreadPoolExecutor:
        pools.append(ThreadPoolExecutor(*arguments, **options))
        return pools[-1]

    monkeypatch.setattr(asgi_handler, "ThreadPoolExecutor", pool)
    yield
    for each in pools:
        each.shutdown()


def scope(method: str = "GET", path: bytes = b"/", **changes: Any) -> dict[str, Any]:
    return {
        "type": "http",
        "method": method,
        "path": path.decode(),
        "raw_path": path,
        "query_string": b"a=%20b",
        "http_version": "1.1",
        "scheme": "http",
        "server": ("127.0.0.1", 8000),
        "client": ("192.0.2.7", 4711),
        "headers": [],
    } | changes


def wsgi(view: Callable[[dict[str, Any]], HttpResponseBase]) -> Callable[..., HttpResponseBase]:
    """`view` of the environment, called as Django's WSGI handler is."""

    def application(environ: dict[str, Any], start_response: Callable[..., Any]) -> HttpResponseBase:
        response = view(environ)
        start_response(f"{response.status_code} {response.reason_phrase}", list(response.items()))
        return response

    return application


def served(
    view: Callable[[dict[str, Any]], HttpResponseBase], request: dict[str, Any], body: bytes = b""
) -> tuple[int, dict[bytes, bytes], list[bytes]]:
    """Status, headers and pieces of the answer to `request`."""
    messages = [{"type": "http.request", "body": body, "more_body": False}]
    answered: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        if not messages:
            await asyncio.Event().wait()
        return messages.pop(0)

    async def send(message: Any) -> None:
        answered.append(message)

    asyncio.run(Handler(wsgi(view))(request, receive, send))
    start, *rest = answered
    assert [message.get("more_body", False) for message in rest] == [True] * (len(rest) - 1) + [False]
    return start["status"], dict(start["headers"]), [message["body"] for message in rest]


def test_a_request_becomes_the_environment_of_wsgi() -> None:
    pairs = (
        "host a.example",
        "x-one 1",
        "x-one 2",
        "cookie a=1",
        "cookie b=2",
        "x_forwarded_for 198.51.100.1",
    )
    headers = [tuple(pair.encode().split()) for pair in pairs]
    environ = wsgi_environ(scope("POST", b"/caf%C3%A9/%FF", headers=headers))

    assert environ["PATH_INFO"].encode("latin-1") == b"/caf\xc3\xa9/\xff"
    assert (environ["REQUEST_METHOD"], environ["QUERY_STRING"]) == ("POST", "a=%20b")
    assert (environ["REMOTE_ADDR"], environ["SERVER_PORT"]) == ("192.0.2.7", "8000")
    assert (environ["HTTP_X_ONE"], environ["HTTP_COOKIE"]) == ("1,2", "a=1; b=2")
    # A header with an underscore cannot pass for a proxy's.
    assert "HTTP_X_FORWARDED_FOR" not in environ


@pytest.mark.parametrize("framing", [(b"content-length", b"5"), (b"transfer-encoding", b"chunked")])
def test_django_reads_a_complete_body(framing: tuple[bytes, bytes]) -> None:
    def view(environ: dict[str, Any]) -> HttpResponse:
        assert "HTTP_TRANSFER_ENCODING" not in environ
        assert environ["CONTENT_LENGTH"] == "5"
        return HttpResponse(environ["wsgi.input"].read())

    assert served(view, scope("POST", headers=[framing]), b"hello")[2] == [b"hello"]


def test_a_refused_body_is_left_to_the_middleware(settings: Any) -> None:
    settings.FRONTRUNNER_MAX_BODY_BYTES = 1000

    def view(environ: dict[str, Any]) -> HttpResponse:
        assert (environ["CONTENT_LENGTH"], environ["wsgi.input"].read()) == ("0", b"")
        refusal: Problem = environ[BODY_REFUSAL]
        return refusal.response()

    large = b"a" * (1001 + asgi_handler.BODY_MARGIN_BYTES)
    assert served(view, scope("POST", headers=[(b"transfer-encoding", b"chunked")]), large)[0] == 413


def test_the_middleware_answers_for_a_refused_body(client: Client, db: None) -> None:
    refusal = Problem("body_too_slow", "too slow")

    answer = client.post("/api/v1/enrol", **{BODY_REFUSAL: refusal})

    assert (answer.status_code, answer.json()["code"]) == (408, "body_too_slow")
    assert answer.json()["request_id"] == answer.headers["X-Request-ID"]


def test_the_administration_takes_the_largest_front() -> None:
    assert asgi_handler.ADMINISTRATION_BYTES > LARGEST_FILE_BYTES + asgi_handler.BODY_MARGIN_BYTES

    form = b"a" * LARGEST_FILE_BYTES
    request = scope("POST", b"/admin/fronts/", headers=[(b"transfer-encoding", b"chunked")])
    _, _, pieces = served(lambda environ: HttpResponse(environ["CONTENT_LENGTH"]), request, form)
    assert pieces == [str(len(form)).encode()]


def test_a_large_page_is_sent_in_pieces() -> None:
    page = bytes(range(256)) * 1024

    _, _, pieces = served(lambda _: HttpResponse(page), scope())

    assert b"".join(pieces) == page
    assert max(map(len, pieces)) <= asgi_handler.CHUNK_BYTES


def test_a_file_is_read_while_it_is_sent_and_closed_then(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 200_000)
    opened = path.open("rb")

    _, headers, pieces = served(lambda _: FileResponse(opened), scope())

    assert (headers[b"Content-Length"], sum(map(len, pieces))) == (b"200000", 200_000)
    assert opened.closed


def test_a_stream_is_complete_before_it_is_sent() -> None:
    def view(_: object) -> StreamingHttpResponse:
        return StreamingHttpResponse(iter([b"one", b"two"]))

    _, headers, pieces = served(view, scope())

    assert headers[b"Content-Length"] == b"6"
    assert b"".join(pieces) == b"onetwo"


def test_a_stream_that_fails_is_refused_as_a_whole() -> None:
    def failing() -> Iterator[bytes]:
        yield b"one"
        raise OperationalError("the database is away")

    request = scope(path=b"/api/v1/me/data")
    status, headers, pieces = served(lambda _: StreamingHttpResponse(failing()), request)

    assert (status, headers[b"Content-Type"]) == (503, b"application/problem+json")
    assert b"database_unavailable" in b"".join(pieces)


def test_head_has_the_headers_alone() -> None:
    opened = io.BytesIO(b"x" * 100)

    _, headers, pieces = served(lambda _: FileResponse(opened), scope("HEAD"))

    assert (headers[b"Content-Length"], pieces) == (b"100", [b""])
    assert opened.closed


class Caller:
    """A client that may leave before it is answered."""

    def __init__(self, request: dict[str, Any]) -> None:
        self.request, self.left = request, asyncio.Event()
        self.read_body = False
        self.answered: list[Any] = []

    async def receive(self) -> dict[str, Any]:
        if not self.read_body:
            self.read_body = True
            return {"type": "http.request", "body": b"", "more_body": False}
        await self.left.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: Any) -> None:
        self.answered.append(message)

    def call(self, handler: Handler) -> "asyncio.Task[None]":
        return asyncio.ensure_future(handler(self.request, self.receive, self.send))

    @property
    def status(self) -> int:
        return int(self.answered[0]["status"])


@pytest.fixture
def full(settings: Any) -> Full:
    """A handler of two threads and at most three requests, the event that lets them go, what ran."""
    settings.FRONTRUNNER_WEB_THREADS, settings.FRONTRUNNER_MAX_WAITING = 2, 3
    going, ran = threading.Event(), []

    def view(environ: dict[str, Any]) -> HttpResponse:
        assert going.wait(60)
        ran.append(environ["PATH_INFO"])
        return HttpResponse("done")

    return Handler(wsgi(view)), going, ran


def test_what_waits_beyond_the_limit_is_refused_unread_and_health_is_answered(
    full: Full,
) -> None:
    handler, going, ran = full

    async def crowd() -> list[Caller]:
        callers = [Caller(scope(path=b"/%d" % number)) for number in range(6)]
        calls = [caller.call(handler) for caller in callers]
        await asyncio.wait(calls[3:])
        late, health = Caller(scope("POST")), Caller(scope(path=b"/healthz"))
        await asyncio.wait([late.call(handler), health.call(handler)])
        assert (late.status, late.read_body, health.status) == (503, False, 200)
        assert ran == []
        going.set()
        await asyncio.wait(calls)
        return callers

    callers = asyncio.run(crowd())

    assert [caller.status for caller in callers] == [200, 200, 200, 503, 503, 503]
    refused = callers[-1].answered
    headers = dict(refused[0]["headers"])
    assert b'"code":"busy"' in refused[1]["body"]
    assert int(headers[b"Retry-After"]) in range(2, 11)


def test_a_request_whose_client_left_while_it_waited_never_runs(
    full: Full,
) -> None:
    handler, going, ran = full

    async def crowd() -> None:
        first, second, third = (Caller(scope(path=b"/%d" % number)) for number in range(3))
        calls = [caller.call(handler) for caller in (first, second, third)]
        second.left.set()
        await calls[1]
        assert second.answered == []
        going.set()
        await asyncio.wait(calls)

    asyncio.run(crowd())

    assert ran == ["/0", "/2"]


@pytest.mark.parametrize("folder", ["sequences", "trajectories", "plans", "shaders", "modules"])
def test_downloads_by_digest_need_no_request_thread(settings: Any, folder: str, tmp_path: Path) -> None:
    settings.FRONTRUNNER_WEB_THREADS, settings.FRONTRUNNER_MAX_WAITING = 2, 3
    (tmp_path / "chunk").write_bytes(b"depth")
    going, threads = threading.Event(), []

    def view(environ: dict[str, Any]) -> Any:
        if environ["PATH_INFO"].startswith(f"/{folder}/"):
            threads.append(threading.current_thread().name)
            return FileResponse((tmp_path / "chunk").open("rb"))
        assert going.wait(60)
        return HttpResponse("done")

    async def crowd() -> None:
        handler = Handler(wsgi(view))
        others = [Caller(scope(path=b"/%d" % number)).call(handler) for number in range(6)]
        await asyncio.wait(others[3:])
        chunk, head = (Caller(scope(method, b"/%s/1" % folder.encode())) for method in ("GET", "HEAD"))
        await asyncio.wait([chunk.call(handler), head.call(handler)])
        assert not any(other.done() for other in others[:3])
        going.set()
        await asyncio.wait(others)
        assert (chunk.status, head.status) == (200, 200)
        assert b"".join(message["body"] for message in chunk.answered[1:]) == b"depth"

    asyncio.run(crowd())
    assert {name.partition("_")[0] for name in threads} == {"file"}


def test_downloads_beyond_the_limit_are_refused(full: Full) -> None:
    handler, going, _ = full

    async def crowd() -> None:
        callers = [Caller(scope(path=b"/plans/%d" % number)) for number in range(4)]
        calls = [caller.call(handler) for caller in callers]
        await calls[3]
        other = Caller(scope())
        held = other.call(handler)
        going.set()
        await asyncio.wait([*calls[:3], held])
        assert [caller.status for caller in (*callers, other)] == [200, 200, 200, 503, 200]

    asyncio.run(crowd())


def test_reading_goes_on_while_every_writer_waits(full: Full, settings: Any) -> None:
    settings.FRONTRUNNER_MAX_WAITING = 10
    going = threading.Event()

    def view(environ: dict[str, Any]) -> HttpResponse:
        assert environ["REQUEST_METHOD"] == "GET" or going.wait(60)
        return HttpResponse("done")

    async def crowd() -> None:
        handler = Handler(wsgi(view))
        writers = [Caller(scope("POST")).call(handler) for _ in range(5)]
        reader = Caller(scope())
        await reader.call(handler)
        assert reader.status == 200
        assert not any(writer.done() for writer in writers)
        going.set()
        await asyncio.wait(writers)

    asyncio.run(crowd())
